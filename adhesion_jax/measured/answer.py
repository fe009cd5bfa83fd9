"""Every curve fitted to a measured record, and one answer for the peak from all of them."""

from collections.abc import Callable, Mapping
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import scipy
from jaxtyping import Float, Int
from scipy.special import ndtri, stdtr

from adhesion_jax import runtime
from adhesion_jax.curves import CURVES, Curve
from adhesion_jax.inference.fit import MeasuredFit, fitted, missing_columns
from adhesion_jax.inference.noise import SPEED, SlipNoise, slip_noise
from adhesion_jax.inference.rows import Rows, arranged
from adhesion_jax.inference.start import least_squares
from adhesion_jax.inference.weighing import alike, weighed
from adhesion_jax.records import Record

#: A curve of three parameters that needs no further column.
_WEIGHING = "kiencke"


class Fits(NamedTuple):
    """The fit of every curve, by name, the noise of the slip, and the measured rows."""

    curves: Mapping[str, MeasuredFit]
    slip: SlipNoise
    rows: Rows

    @property
    def best(self) -> str:
        """The name of that which predicts best what was left out of it."""
        densities = log_densities(self.curves)
        return max(densities, key=lambda name: densities[name])


def searched(
    curves: Mapping[str, Curve], record: Record
) -> Mapping[str, Float[np.ndarray, " free"]]:
    """The least squares start of each curve; nearly all the time is compilation."""
    with runtime.threads() as pool:
        found = pool.map(lambda curve: least_squares(curve, record), curves.values())
        return dict(zip(curves, found, strict=True))


def fit_curves(
    curves: Mapping[str, Curve],
    record: Record,
    run: Int[np.ndarray, " points"],
    slip_is_velocity: bool,
    given: float | None = None,
    progress: Callable[[str, float], None] = runtime.silent,
    starts: Mapping[str, Float[np.ndarray, " free"]] | None = None,
) -> Fits:
    """Fit every curve that can be evaluated on the record, in the order of `curves`.

    `run` is the run of each point, from 0. `given` is the standard deviation of the noise of the
    wheel speed in m/s (of the slip, where there is no vehicle speed; 0 for an exact slip); if it is
    not given, and the points are in time, it is estimated. `progress` is called with words and the
    share done. The fits begin at `starts`, which have Kiencke's too, or at those that are searched.
    """
    known = {n: c for n, c in curves.items() if not missing_columns(c, record.conditions)}
    needed = {name for curve in known.values() for name in curve.NEEDS}
    rows = arranged(record, run, {*needed, *({SPEED} & record.conditions.keys())})
    courses = [np.arange(*ends) for ends in pairwise(rows.starts)] if rows.ordered else []
    slip = slip_noise(rows.slip, rows.conditions.get(SPEED), courses, given)
    progress("search", 0.0)
    # The curve whose slope weighs rows of noisy slip, whichever curves are asked for.
    usual = {_WEIGHING: CURVES[_WEIGHING]} if slip.sigma else {}
    starts = starts or searched({**usual, **known}, record)
    expected, weights = rows, alike(rows)
    for name, curve in usual.items():
        expected, slip, weights = weighed(curve, starts[name], rows, slip, slip_is_velocity)
    found = {}
    for done, (name, curve) in enumerate(known.items()):
        progress(name, done / len(known))
        found[name] = fitted(curve, starts[name], expected, slip, weights, slip_is_velocity)
    progress("fits", 1.0)
    return Fits(found, slip, rows)


#: The lowest slip at which it is asked whether adhesion falls, as a share of the largest one
#: considered; and the number of slips, first over all of them, then about the interval.
_LOWEST, _SLIPS = 1e-4, 200

#: Curves of less weight are not asked for the peak.
_LEAST_WEIGHT = 1e-4

#: Draws of the weights of the parts that were left out.
_DRAWS = 1000


class Estimate(NamedTuple):
    """The median of a mixture, and its 95 % interval; NaN where there is none."""

    value: float
    low: float
    high: float


#: Where there is nothing to be said.
NOT_KNOWN = Estimate(np.nan, np.nan, np.nan)


class Answer(NamedTuple):
    """The peak, as a mixture of what each curve says of it.

    Each curve with its departure gives a Student distribution of the logarithm about its own
    estimate, so that no end is negative. An end of the interval has 2.5 % of the mixture of these
    beyond it (Turek and Fletcher 2012, Computational Statistics and Data Analysis 56:2809-2815).
    The slip of the peak is that where the laws turn from rise to fall.
    """

    weights: Mapping[str, float]  # by the name of the curve, of sum 1
    mu_max: Estimate
    slip_opt: Estimate  # NaN if the curves without a peak have most of the weight
    without_peak: float  # weight of the curves without a peak


def dependence(fits: Mapping[str, MeasuredFit]) -> float:
    """How many dependent rows tell as much as one independent row, at least 1.

    Of all curves, the one that leaves least of itself in the residual says it.
    """
    told = [fit.departure.inflation for fit in (_usable(fits) or fits).values()]
    return max(min(told), 1.0)


def log_densities(fits: Mapping[str, MeasuredFit]) -> Mapping[str, float]:
    """Of all parts that were left out, less what the freedom of the departure costs.

    The larger, the better a curve predicts the points, and the less it must bend to do so.
    """
    depend = dependence(fits)
    return {
        name: float(np.sum(fit.left_out)) / depend - fit.departure.occam
        for name, fit in fits.items()
    }


def _usable(fits: Mapping[str, MeasuredFit]) -> dict[str, MeasuredFit]:
    """The fits that an answer may rest on."""
    return {
        name: fit
        for name, fit in fits.items()
        if np.all(np.isfinite(fit.left_out)) and fit.peak.adhesion > 0 and fit.mu_max_se < np.inf
    }


def answered(fits: Mapping[str, MeasuredFit]) -> Answer:
    """The one answer of several fits to the same points."""
    usable = _usable(fits)
    if not usable:
        return Answer(dict.fromkeys(fits, 0.0), NOT_KNOWN, NOT_KNOWN, 1.0)
    found = predictive_weights(
        np.stack([fit.left_out for fit in usable.values()]) / dependence(usable),
        np.array([fit.departure.occam for fit in usable.values()]),
    )
    weights = dict.fromkeys(fits, 0.0) | dict(zip(usable, found.tolist(), strict=True))
    counted = [(fit, weights[name]) for name, fit in fits.items() if weights[name] > _LEAST_WEIGHT]
    peaked = [(fit, weight) for fit, weight in counted if fit.peak.found]
    with_peak = sum(weight for _, weight in peaked)
    level = [(fit.peak.adhesion, fit.mu_max_se, fit.degrees, weight) for fit, weight in counted]
    return Answer(
        weights,
        _mixture(level),
        _turning(peaked) if with_peak > 0.5 else NOT_KNOWN,
        1.0 - with_peak / sum(weight for _, weight in counted),
    )


def _turning(peaked: list[tuple[MeasuredFit, float]]) -> Estimate:
    """The slip of the peak, and its 95 % interval, by where the laws turn from rise to fall."""
    weight = np.array([weight for _, weight in peaked])
    peaks = np.array([fit.peak.slip for fit, _ in peaked])
    order = np.argsort(peaks)
    middle = float(peaks[order][np.searchsorted(np.cumsum(weight[order]), 0.5 * weight.sum())])

    def found(low: float, high: float) -> Estimate:
        slips = np.geomspace(low, high, _SLIPS)
        falls = weight / weight.sum() @ np.stack([fit.falls(slips) for fit, _ in peaked])
        return turned(np.sqrt(slips[1:] * slips[:-1]), falls, middle)

    limit = peaked[0][0].slip_limit
    step = _LOWEST ** (-1 / (_SLIPS - 1))
    _, low, high = found(_LOWEST * limit, limit)
    return found(low / step, min(high * step, limit))


def turned(
    slip: Float[np.ndarray, " slips"], falls: Float[np.ndarray, " slips"], middle: float
) -> Estimate:
    """Where the probability `falls` that adhesion falls at a slip is 50, 2.5 and 97.5 %.

    The peak lies below a slip with that probability, so that where adhesion is nearly level the
    interval is as wide as the level stretch. Of several such places each is the one next to
    `middle`; one that is not seen is the end of the slips.
    """
    score = ndtri(np.clip(falls, 1e-12, 1 - 1e-12))
    start = int(np.clip(np.searchsorted(slip, middle), 1, slip.size - 1))

    def crossing(level: float) -> float:
        if score[start - 1] < level:
            beyond = start + np.flatnonzero(score[start:] >= level)
            if not beyond.size:
                return float(slip[-1])
            i = int(beyond[0])
        else:
            below = np.flatnonzero(score[:start] < level)
            if not below.size:
                return float(slip[0])
            i = int(below[-1]) + 1
        share = (level - score[i - 1]) / (score[i] - score[i - 1])
        return float(slip[i - 1] * (slip[i] / slip[i - 1]) ** share)

    return Estimate(*(crossing(float(ndtri(share))) for share in (0.5, 0.025, 0.975)))


def predictive_weights(
    log_density: Float[np.ndarray, "curves parts"], cost: Float[np.ndarray, " curves"]
) -> Float[np.ndarray, " curves"]:
    """How much more probable each curve made the parts that were left out than the others did.

    The mean, over draws of the weights of the parts (Dirichlet, all alike), of weights proportional
    to the product of their densities: pseudo Bayesian model averaging with the Bayesian bootstrap
    (Yao, Vehtari, Simpson and Gelman 2018, Bayesian Analysis 13:917-1007). A curve that is better
    in a few parts alone does not take all the weight. `cost` is taken off the sum of each curve:
    the freedom of its departure, so that of curves that predict alike the one from which the
    points depart least has most weight.
    """
    parts = log_density.shape[1]
    drawn = np.random.default_rng(0).dirichlet(np.ones(parts), _DRAWS) * parts
    total = drawn @ log_density.T - cost
    weights = np.exp(total - total.max(axis=1, keepdims=True))
    return np.mean(weights / weights.sum(axis=1, keepdims=True), axis=0)


def band_of_answer(
    fits: Mapping[str, MeasuredFit], answer: Answer, slip: Float[np.ndarray, " points"]
) -> Float[np.ndarray, "points 3"]:
    """Median and ends of the pointwise 95 % interval of the mixture of the laws."""
    told = []
    for name, weight in answer.weights.items():
        if weight > _LEAST_WEIGHT:
            found = fits[name].law.at(slip)
            told.append((found.adhesion, *fits[name].errors(found.by_parameter), weight))
    return np.array(
        [
            _mixture(
                [(law[i], error[i], degrees[i], weight) for law, error, degrees, weight in told]
            )
            for i in range(slip.size)
        ]
    )


def _mixture(parts: list[tuple[float, float, float, float]]) -> Estimate:
    """Median and 2.5 % ends of Student distributions of the logarithm, or of what is not positive.

    Each is given by its centre, standard error, degrees of freedom and weight.
    """
    centre, error, degrees, weight = np.array(parts).T
    positive = bool(np.all(centre > 0))
    if positive:
        centre, error = np.log(centre), error / centre
    error, weight = np.maximum(error, 1e-12 * np.abs(centre) + 1e-15), weight / weight.sum()

    def share_below(value: float) -> float:
        return float(weight @ stdtr(degrees, (value - centre) / error))

    def at(share: float) -> float:
        reach = 40 * error
        low, high = float(np.min(centre - reach)), float(np.max(centre + reach))
        return float(
            scipy.optimize.brentq(lambda value: share_below(value) - share, low, high, xtol=1e-14)
        )

    ends = at(0.5), at(0.025), at(0.975)
    return Estimate(*(float(np.exp(min(end, 700.0))) if positive else end for end in ends))
