"""What the noise of a fit is: told, and never part of the fit."""

from typing import NamedTuple

import numpy as np

from adhesion_jax.data.runs import RunSet
from adhesion_jax.data.stretches import stretches
from adhesion_jax.discovery.model.fitting import sigma_of
from adhesion_jax.discovery.model.rows import predicted
from adhesion_jax.effects.law import CorrectedLaw
from adhesion_jax.inference.noise import RunNoise, SlipNoise, described, slip_noise
from adhesion_jax.inference.rows import Rows
from adhesion_jax.inference.sums import Variance

#: Change of the slip by which the slope of a law is taken.
_NUDGE = 1e-5


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


def courses(runs: RunSet) -> list[np.ndarray]:
    """The rows of each signal of the slip in time, without a gap; none where there is no time.

    There is one for each run and axle; blocks of one run follow each other.
    """
    conditions = runs.whole.conditions
    if "time_s" not in conditions:
        return []
    series = np.zeros_like(runs.run) if runs.blocks else runs.run
    if "axle" in conditions:
        axles, axle = np.unique(conditions["axle"], return_inverse=True)
        series = series * axles.size + axle
    return list(stretches(conditions["time_s"], series))


def slip_noise_of(runs: RunSet, given: float | None) -> SlipNoise:
    """The noise of the slip by its course in time, or as given (`inference.noise`)."""
    whole = runs.whole
    return slip_noise(whole.slip, whole.conditions.get("vehicle_speed_mps"), courses(runs), given)


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
    runs: RunSet, law: CorrectedLaw, adhesion: np.ndarray, share: float, slip: SlipNoise
) -> Left:
    """What a law leaves whose prediction is `adhesion`, and where that share of slip noise acts."""
    rows, whole = rows_of(runs), runs.whole
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
