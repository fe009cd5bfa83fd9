"""Whether the rail changed between runs, or between groups of them: a test of levels."""

from typing import NamedTuple

import numpy as np
import pandas as pd
import scipy
from jaxtyping import Float
from scipy.linalg import helmert

from adhesion_jax.measured.fit import MeasuredFit
from adhesion_jax.measured.noise import MISFITS, normal_equations, without_correlation

#: Largest number of groups that are compared.
MOST_GROUPS = 1000

#: A change between groups is claimed if its p is at most this.
_SIGNIFICANT = 0.01

#: Places along the variance of the runs within their groups.
_PLACES = 400


class Comparison(NamedTuple):
    """The largest adhesion of each group, and the test that all are alike."""

    by: str
    table: pd.DataFrame  # group, runs, mu_max, mu_max_se, mu_max_lo, mu_max_hi
    statistic: float  # Wald's, by the number of differences: F if nothing changed
    differences: int
    degrees: float  # of freedom of the noise
    p: float
    run_scatter: float  # of the runs of a group, relative; 0 where a group is a single run

    @property
    def changed(self) -> bool:
        return self.p <= _SIGNIFICANT


def compared(fit: MeasuredFit, labels: pd.Series, by: str) -> Comparison:
    """The levels of the groups of runs, under one curve whose other parameters are common.

    Run i has the adhesion (1 + l_i) f(s). The levels and the parameters of the curve (with what it
    misses) are estimated together, under the autocorrelation that was found. Between groups of
    several runs a difference counts beyond the scatter of the runs within them, whose variance w^2
    is estimated by restricted maximum likelihood: l = X g + w u + errors. The Wald statistic for
    equal g has F's distribution, with as many degrees of freedom as there are independent points
    beyond the parameters, or runs beyond the groups. `labels` is the group of each run.
    """
    codes, groups = pd.factorize(labels)
    runs, count = len(labels), len(groups)
    contrasts = helmert(runs)  # [runs - 1, runs]: the mean level belongs to the curve
    estimate, covariance = _levels(fit, contrasts)
    members = (codes[:, None] == np.arange(count)).astype(float)
    single = count == runs
    variance = 0.0 if single else _within(estimate, covariance, contrasts @ members)
    whole = covariance + variance * np.eye(runs - 1)

    # Groups' levels about their mean over the runs: of g, the part that the contrasts see.
    design = contrasts @ members @ helmert(count).T
    weighed = np.linalg.solve(whole, np.column_stack([design, estimate]))
    of_groups = np.linalg.inv(design.T @ weighed[:, :-1])
    level = of_groups @ (design.T @ weighed[:, -1])
    degrees = _degrees(fit, runs) if single else float(runs - count)
    statistic = float(level @ np.linalg.solve(of_groups, level)) / (count - 1)

    share = members.sum(axis=0) / runs
    about = helmert(count).T - share @ helmert(count).T  # levels less their mean over the runs
    levels, errors = about @ level, about @ of_groups @ about.T
    mu_max = float(fit.peak.adhesion)
    half = fit.quantile
    # Of these runs, not of further ones: their scatter is no part of the error of their mean.
    common = max((fit.mu_max_se / mu_max) ** 2 - fit.run_scatter**2 / runs, 0.0)
    se = mu_max * np.sqrt(np.diagonal(errors) + common)
    height = mu_max * (1 + levels)
    table = pd.DataFrame(
        {
            by: groups,
            "runs": members.sum(axis=0).astype(int),
            "mu_max": height,
            "mu_max_se": se,
            "mu_max_lo": height - half * se,
            "mu_max_hi": height + half * se,
        }
    )
    p = float(scipy.stats.f.sf(statistic, count - 1, degrees))
    return Comparison(by, table, statistic, count - 1, degrees, p, float(np.sqrt(variance)))


def _levels(
    fit: MeasuredFit, contrasts: Float[np.ndarray, "contrasts runs"]
) -> tuple[Float[np.ndarray, " contrasts"], Float[np.ndarray, "contrasts contrasts"]]:
    """Contrasts of the levels of the runs, and their covariance by the noise within the runs."""
    found, noise = fit.products, fit.noise
    white = without_correlation(found.parts.sum(axis=1), noise.autocorrelation)
    rows = without_correlation(found.levels, noise.autocorrelation)
    matrix, right, used = normal_equations(white, noise.misfit, ~fit.held)
    # The mean level stands beside the parameters, with which it may be one and the same.
    used = np.append(used, found.derivatives + MISFITS)
    matrix = np.block([[matrix, white[used[:-1], -2][:, None]], [white[-2, used]]])
    scale = 1 / np.sqrt(np.maximum(np.diagonal(matrix), 1e-300))
    inverse = np.linalg.pinv(matrix * scale[:, None] * scale, rcond=1e-11, hermitian=True)
    inverse = inverse * scale[:, None] * scale
    across = contrasts @ rows[:, used]
    own = contrasts @ (rows[:, -2, None] * contrasts.T) - across @ inverse @ across.T
    error = contrasts @ rows[:, -1] - across @ inverse @ np.append(right, white[-2, -1])
    covariance = np.linalg.inv(own)
    return covariance @ error, noise.sigma**2 * covariance


def _within(
    estimate: np.ndarray, covariance: np.ndarray, design: Float[np.ndarray, "contrasts groups"]
) -> float:
    """The variance of the levels of runs within groups, by restricted maximum likelihood."""
    # What the groups do not explain.
    left = np.linalg.svd(design)[0][:, np.linalg.matrix_rank(design) :]
    if left.shape[1] == 0:
        return 0.0
    values, vectors = np.linalg.eigh(left.T @ covariance @ left)
    along = (vectors.T @ left.T @ estimate) ** 2
    highest = max(float(along.sum()), 1e-300)
    variances = np.concatenate([[0.0], np.geomspace(1e-9 * highest, 10 * highest, _PLACES)])
    size = values + variances[:, None]
    loss = np.sum(np.log(size) + along / size, axis=1)
    return float(variances[loss.argmin()])


def _degrees(fit: MeasuredFit, runs: int) -> float:
    r = fit.noise.autocorrelation
    return max(fit.points * (1 - r) / (1 + r) - float(np.sum(~fit.held)) - runs, 1.0)
