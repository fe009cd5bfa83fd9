"""What the noise of a fit is: told, and never part of the fit."""

from typing import NamedTuple

import numpy as np
import scipy
from scipy.signal import savgol_filter

from adhesion_jax.data.runs import RunSet
from adhesion_jax.discovery.model.fitting import Fitted, sigma_of, slope_of
from adhesion_jax.discovery.model.rows import predicted
from adhesion_jax.effects.law import CorrectedLaw
from adhesion_jax.inference.noise import RunNoise, described
from adhesion_jax.inference.rows import Rows
from adhesion_jax.inference.slip import SlipNoise, slip_noise
from adhesion_jax.inference.sums import Variance

#: The noise of the slip is looked at where it could make this share of the variance of adhesion. By
#: hand.
_NOTICEABLE = 0.1

#: Rows through which the parabolas are laid.
_WINDOW = 15

#: Change of the slip by which the slope of a law is taken.
_NUDGE = 1e-5


class NoisySlip(NamedTuple):
    """Noise of the slip signal that adhesion does not follow."""

    sigma: float  # of the wheel speed in m/s, or of the slip
    of_wheel_speed: bool
    p: float


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


def noise_of(
    runs: RunSet, law: CorrectedLaw, adhesion: np.ndarray, share: float, given: float | None
) -> RunNoise:
    """The noise of single rows about a law (`inference.noise`), also if it was fitted to blocks.

    `adhesion` is the prediction of the law, `share` that of the slip's noise that acts.
    """
    rows, whole = rows_of(runs), runs.whole
    slip = slip_noise_of(runs, given)
    spread = share * slip.spread
    slope = np.zeros(whole.slip.size)
    if spread.any():
        moved = runs._replace(whole=whole._replace(slip=whole.slip + _NUDGE))
        slope = (predicted(law, moved) - adhesion) / _NUDGE
    error, by_slip = whole.adhesion - adhesion, (slope * spread) ** 2
    sigma = sigma_of(error, rows.design, by_slip)
    variance = Variance(sigma, 1 / rows.design + by_slip / sigma**2, spread)
    slip = slip._replace(sigma=share * slip.sigma)
    return described(rows, error, slope, adhesion, variance, slip)


def noisy_slip(fitted: Fitted, slip: SlipNoise) -> NoisySlip | None:
    """The noise of the slip, if adhesion shows it.

    Where d is the deviation of the slip from parabolas through 15 neighbours, noise in it leaves
    -m'(l) d in the residual, and a slip that truly moves leaves nothing: the regression of the
    residual on -m'(l) d is the share of the variance of d that is noise. Its p is that of Student's
    t over the runs.
    """
    setting = fitted.setting
    if not slip.sigma:
        return None
    if slip.given:
        return NoisySlip(slip.sigma, slip.of_wheel_speed, 0.0)
    inside = setting.problem.points > 0
    measured = np.asarray(setting.problem.data.slip)
    probe = np.zeros(measured.shape)
    slope = slope_of(fitted)
    for run, used in enumerate(inside):
        if used.sum() >= _WINDOW:
            course = measured[run, used]
            away = course - savgol_filter(course, _WINDOW, 2)
            probe[run, used] = -slope[run, used] * away
    weight = setting.root**2
    size = float((weight * probe**2).sum())
    if not size > 0 or size < _NOTICEABLE * float(inside.sum()):
        return None
    share = float((weight * probe * fitted.error).sum()) / size
    own = (weight * probe * (fitted.error - share * probe)).sum(axis=1) / size
    used_runs = np.any(probe != 0, axis=1)
    runs = int(used_runs.sum())
    if runs < 2 or share <= 0:
        return None
    error = float(np.sqrt(runs / (runs - 1) * np.sum(own[used_runs] ** 2)))
    p = float(scipy.stats.t.sf(share / max(error, 1e-300), runs - 1))
    sigma = float(np.sqrt(min(share, 1.0))) * slip.sigma
    return NoisySlip(sigma, slip.of_wheel_speed, p)
