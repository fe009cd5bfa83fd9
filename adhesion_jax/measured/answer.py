"""One answer for the peak that includes the choice of the curve, weighed by cross-validation."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import scipy
from jaxtyping import Float
from scipy.special import stdtr

from adhesion_jax.measured.fit import MeasuredFit
from adhesion_jax.measured.law import law_with_errors

#: Curves of less weight are not asked for the peak.
_LEAST_WEIGHT = 1e-4


class Estimate(NamedTuple):
    """The median of a mixture, and its 95 % interval; NaN where there is none."""

    value: float
    low: float
    high: float


class Answer(NamedTuple):
    """The peak, as a mixture of what each curve says of it.

    Each curve with what it misses gives a Student distribution about its own estimate. An end of
    the interval has 2.5 % of the mixture of these beyond it (Turek and Fletcher 2012,
    Computational Statistics and Data Analysis 56:2809-2815). The weights are those of
    `predictive_weights`.
    """

    weights: Mapping[str, float]  # by the name of the curve, of sum 1
    mu_max: Estimate
    slip_opt: Estimate  # NaN if the curves without a peak have most of the weight
    without_peak: float  # weight of the curves without a peak


def answered(fits: Mapping[str, MeasuredFit]) -> Answer:
    """The one answer of several fits to the same points."""
    usable = {
        name: fit
        for name, fit in fits.items()
        if np.all(np.isfinite(fit.left_out)) and np.isfinite(fit.mu_max_se)
    }
    nothing = Estimate(np.nan, np.nan, np.nan)
    if not usable:
        return Answer(dict.fromkeys(fits, 0.0), nothing, nothing, 1.0)
    found = predictive_weights(np.stack([fit.left_out for fit in usable.values()]))
    weights = dict.fromkeys(fits, 0.0) | dict(zip(usable, found.tolist(), strict=True))
    counted = [(fit, weights[name]) for name, fit in fits.items() if weights[name] > _LEAST_WEIGHT]
    peaked = [(fit, weight) for fit, weight in counted if fit.peak.found]
    with_peak = sum(weight for _, weight in peaked)
    return Answer(
        weights,
        _mixture([(float(f.peak.adhesion), f.mu_max_se, f.degrees, w) for f, w in counted]),
        _mixture([(float(f.peak.slip), f.slip_opt_se, f.degrees, w) for f, w in peaked])
        if with_peak > 0.5
        else nothing,
        1.0 - with_peak / sum(weight for _, weight in counted),
    )


def predictive_weights(
    log_density: Float[np.ndarray, "curves parts"],
) -> Float[np.ndarray, " curves"]:
    """How much more probable each curve made the parts that were left out than the others did.

    w_k is proportional to prod_i p_ki, p_ki the density of part i by curve k fitted to all others:
    pseudo Bayes factors (Geisser and Eddy 1979, J. Am. Stat. Assoc. 74:153-160). Curves that
    predict alike have like weights, so that the doubt between them stays in the answer. The
    mixture that predicts best (stacking) may give all the weight to one of them.
    """
    total = log_density.sum(axis=1)
    weights = np.exp(total - total.max())
    return weights / weights.sum()


def band_of_answer(
    fits: Mapping[str, MeasuredFit], answer: Answer, slip: Float[np.ndarray, " points"]
) -> Float[np.ndarray, "points 3"]:
    """Median and ends of the pointwise 95 % interval of the mixture of the laws."""
    chosen = [(fits[name], w) for name, w in answer.weights.items() if w > _LEAST_WEIGHT]
    told = [(*law_with_errors(fit.law, slip), fit.degrees, weight) for fit, weight in chosen]
    return np.array(
        [
            _mixture([(law[i], error[i], degrees, weight) for law, error, degrees, weight in told])
            for i in range(slip.size)
        ]
    )


def _mixture(parts: list[tuple[float, float, float, float]]) -> Estimate:
    """Median and 2.5 % ends of Student distributions: centre, standard error, degrees, weight."""
    centre, error, degrees, weight = np.array(parts).T
    error, weight = np.maximum(error, 1e-12 * np.abs(centre) + 1e-300), weight / weight.sum()

    def share_below(value: float) -> float:
        return float(weight @ stdtr(degrees, (value - centre) / error))

    def at(share: float) -> float:
        reach = 40 * error
        low, high = float(np.min(centre - reach)), float(np.max(centre + reach))
        return float(
            scipy.optimize.brentq(lambda value: share_below(value) - share, low, high, xtol=1e-14)
        )

    return Estimate(at(0.5), at(0.025), at(0.975))
