"""What the noise of a fit is: told, and never part of the fit."""

from typing import NamedTuple

import numpy as np
import scipy
from scipy.signal import savgol_filter

from adhesion_jax.data.runs import RunSet
from adhesion_jax.discovery.model.fitting import sigma_of
from adhesion_jax.discovery.model.rows import predicted
from adhesion_jax.effects.law import CorrectedLaw
from adhesion_jax.inference.noise import RunNoise, SlipNoise, described, slip_noise
from adhesion_jax.inference.rows import Rows
from adhesion_jax.inference.sums import TUNING, Variance

#: The noise of the slip is told where it makes this share of the variance of adhesion, and is this
#: share of what jumps in the slip: less is what an inexact curve leaves. By hand.
_NOTICEABLE, _LEAST_SHARE = 0.05, 0.02

#: Largest number of intervals of slip about whose means adhesion is looked at, and rows in each.
_INTERVALS, _ROWS = 200, 20

#: Rows through which the parabolas are laid.
_WINDOW = 15

#: Change of the slip by which the slope of a law is taken.
_NUDGE = 1e-5


class NoisySlip(NamedTuple):
    """Noise of the slip signal that adhesion does not follow."""

    sigma: float  # of the wheel speed in m/s, or of the slip
    of_wheel_speed: bool
    p: float  # NaN where the noise is stated, which nothing tests


def rows_of(runs: RunSet) -> Rows:
    """The rows of runs as the room of inference takes them."""
    whole, edges = runs.whole, np.append(runs.starts, runs.whole.slip.size)
    ordered = "time_s" in whole.conditions and bool(runs.lengths.max() > 2)
    numbers = np.arange(runs.starts.size)
    weights = runs.worth / runs.worth.mean()
    return Rows(
        whole.slip, whole.adhesion, whole.conditions, weights, edges, edges, numbers, ordered,
        not runs.blocks,
    )  # fmt: skip


def slip_noise_of(runs: RunSet, given: float | None) -> SlipNoise:
    """The noise of the slip by its course in time, or as given (`inference.slip`)."""
    return slip_noise(rows_of(runs), runs.whole.conditions.get("vehicle_speed_mps"), given)


class Left(NamedTuple):
    """What a law leaves of every row, also if it was fitted to blocks of them."""

    rows: Rows
    error: np.ndarray  # measured less predicted adhesion
    predicted: np.ndarray
    slope: np.ndarray  # of the law over the slip; 0 where no noise of the slip is known
    variance: Variance
    slip: SlipNoise
    share: float  # of the noise of the slip that acts


def left_by(
    runs: RunSet, law: CorrectedLaw, adhesion: np.ndarray, share: float, given: float | None
) -> Left:
    """What a law leaves whose prediction is `adhesion`, and where that share of slip noise acts."""
    rows, whole = rows_of(runs), runs.whole
    slip = slip_noise_of(runs, given)
    slope = np.zeros(whole.slip.size)
    if slip.sigma:
        moved = runs._replace(whole=whole._replace(slip=whole.slip + _NUDGE))
        slope = (predicted(law, moved) - adhesion) / _NUDGE
    error, spread = whole.adhesion - adhesion, share * slip.spread
    by_slip = (slope * spread) ** 2
    sigma = sigma_of(error, rows.design, by_slip)
    variance = Variance(sigma, 1 / rows.design + by_slip / sigma**2, spread)
    return Left(rows, error, adhesion, slope, variance, slip, share)


def noise_of(left: Left) -> RunNoise:
    """The noise of single rows about a law (`inference.noise`)."""
    slip = left.slip._replace(sigma=left.share * left.slip.sigma)
    return described(left.rows, left.error, left.slope, left.predicted, left.variance, slip)


def noisy_slip(left: Left) -> NoisySlip | None:
    """The noise of the slip, if adhesion shows it.

    Where d is the deviation of the slip from parabolas through 15 neighbours, noise in it leaves
    -m'(l) d in the residual, and a slip that truly moves leaves nothing: the regression of the
    residual on -m'(l) d is the share of the variance of d that is noise, both less their means over
    rows of nearly the same slip, which are not zero where the curve is inexact. Its p is that of
    Student's t over the runs.
    """
    rows, slip = left.rows, left.slip
    if not slip.sigma:
        return None
    if slip.given:
        return NoisySlip(slip.sigma, slip.of_wheel_speed, float("nan"))
    probe = np.zeros(rows.slip.size)
    for first, last in zip(rows.starts[:-1], rows.starts[1:], strict=True):
        if last - first >= _WINDOW:
            course = rows.slip[first:last]
            away = course - savgol_filter(course, _WINDOW, 2)
            probe[first:last] = -left.slope[first:last] * away
    variance = left.variance.row()
    far = np.maximum(np.abs(left.error) / np.sqrt(variance) / TUNING, 1.0)
    weight = 1 / (variance * far)
    count = rows.slip.size
    place = np.argsort(np.argsort(rows.slip)) * max(min(_INTERVALS, count // _ROWS), 1) // count
    whole = np.bincount(place, weight)
    probe, error = (
        one - (np.bincount(place, weight * one) / whole)[place] for one in (probe, left.error)
    )
    size = float(weight @ probe**2)
    if not size > 0:
        return None
    share = float(weight @ (probe * error)) / size
    own = np.add.reduceat(weight * probe * (error - share * probe), rows.starts[:-1]) / size
    used = np.add.reduceat(np.abs(probe), rows.starts[:-1]) > 0
    runs = int(used.sum())
    if runs < 2 or share < _LEAST_SHARE or share * size < _NOTICEABLE * count:
        return None
    deviation = float(np.sqrt(runs / (runs - 1) * np.sum(own[used] ** 2)))
    p = float(scipy.stats.t.sf(share / max(deviation, 1e-300), runs - 1))
    return NoisySlip(float(np.sqrt(min(share, 1.0))) * slip.sigma, slip.of_wheel_speed, p)
