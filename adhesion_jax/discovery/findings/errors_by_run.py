"""Errors before and after with bootstrap intervals; runs are resampled, not points."""

from collections.abc import Callable

import numpy as np
import scipy.stats

from adhesion_jax.data.runs import RunSet
from adhesion_jax.discovery.model.fitting import Fitted
from adhesion_jax.discovery.model.prediction import held_out_loss
from adhesion_jax.discovery.types import Errors, Interval

#: Number of bootstrap samples.
_DRAWS = 1999


def errors(before: np.ndarray, after: np.ndarray, points: np.ndarray, seed: int) -> Errors:
    """Root mean square errors from sums of squared errors and numbers of points, all [runs].

    Intervals of 95 % are between quantiles of a bootstrap over runs, with the same draws before and
    after. Those of 2.5 and 97.5 % would be too narrow, since the runs of a draw scatter about their
    own mean: with n runs and Student's t of n - 1 degrees of freedom they are those of the normal
    deviates -+ sqrt(n/(n - 1)) t (Hesterberg 2015, The American Statistician 69, 371-386). One run
    tells no interval: its ends are NaN.
    """
    used = points > 0
    before, after, points = before[used], after[used], points[used]
    draws = np.random.default_rng([seed, 19]).integers(points.size, size=(_DRAWS, points.size))
    number = points[draws].sum(1)
    drawn_before = np.sqrt(before[draws].sum(1) / number)
    drawn_after = np.sqrt(after[draws].sum(1) / number)
    ratio = np.where(drawn_before > 0, drawn_after / np.maximum(drawn_before, 1e-300), 1.0)
    rms_before = float(np.sqrt(before.sum() / points.sum()))
    rms_after = float(np.sqrt(after.sum() / points.sum()))
    removed = 1 - (rms_after / rms_before) ** 2 if rms_before > 0 else 0.0
    runs = int(used.sum())
    freedom, unknown = max(runs - 1, 1), np.nan if runs < 2 else 0.0
    wide = np.sqrt(runs / freedom) * scipy.stats.t.isf(0.025, freedom)
    ends = scipy.stats.norm.cdf([-wide, wide])

    def interval(value: float, drawn: np.ndarray) -> Interval:
        low, high = np.quantile(drawn, ends)
        return Interval(value, float(low) + unknown, float(high) + unknown)

    return Errors(
        interval(rms_before, drawn_before),
        interval(rms_after, drawn_after),
        interval(removed, 1 - ratio**2),
        runs,
    )


def by_run(runs: RunSet, sum_of: Callable[[slice], float]) -> np.ndarray:
    """A sum over the rows of each run, [runs]: run by run, without another column of all rows."""
    ends = runs.starts + runs.lengths
    return np.array([sum_of(slice(*run)) for run in zip(runs.starts, ends, strict=True)])


def squares(runs: RunSet, adhesion: np.ndarray) -> np.ndarray:
    """The sum of squared errors of each run."""

    def of_run(rows: slice) -> float:
        error = adhesion[rows] - runs.whole.adhesion[rows]
        return float(error @ error)

    return by_run(runs, of_run)


def errors_of(runs: RunSet, before: np.ndarray, after: np.ndarray, seed: int) -> Errors:
    return errors(squares(runs, before), squares(runs, after), runs.lengths, seed)


def validation_of(
    runs: RunSet,
    before: np.ndarray,
    after: np.ndarray,
    plain: Fitted,
    final: Fitted,
    seed: int,
) -> Errors:
    """Errors of runs left out one by one: those of the fit times the growth of their loss."""
    bare, whole = left_out(runs, before, plain), left_out(runs, after, final)
    return errors(bare, whole, runs.lengths, seed)


def left_out(runs: RunSet, adhesion: np.ndarray, fitted: Fitted) -> np.ndarray:
    """The sum of squared errors of each run if it were left out of the fit."""
    return squares(runs, adhesion) * _growth(fitted)


def _growth(fitted: Fitted) -> np.ndarray:
    """The loss of each run when it is left out, over that of the fit to all runs, [runs]."""
    growth = held_out_loss(fitted) / np.maximum(fitted.loss, 1e-300)
    return np.where(fitted.loss > 0, growth, 1.0)[: fitted.setting.problem.runs]
