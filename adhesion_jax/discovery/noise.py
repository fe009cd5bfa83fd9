"""The noise of a campaign: sigma and AR(1) within a run, a random level from run to run."""

from typing import NamedTuple

import numpy as np

from adhesion_jax.discovery.program import Noise

#: Beyond this autocorrelation neighbours are correlated by what the law lacks more than by noise.
#: Whitening would leave only the fastest changes to judge by; points are then taken as they are,
#: and what is claimed rests on the differences between runs, which is valid for any correlation.
MOST = 0.7

#: Points of a run below which its own level leaves no correlation to be seen.
_SHORT = 5


def white_noise(points: np.ndarray, sigma: float) -> Noise:
    """No correlation and no scatter of the runs."""
    return Noise(points, np.array(sigma), np.array(0.0), np.array(0.0))


class Moments(NamedTuple):
    """What a residual looks like, be it noise or not."""

    sigma: float
    autocorrelation: float  # of neighbours within a run
    run_scatter: float  # of the factors of runs, beyond what sigma explains


def estimate_noise(
    weight: np.ndarray, residual: np.ndarray, level: np.ndarray, blocks: bool
) -> Noise:
    """What of the moments of a residual is taken for noise."""
    sigma, correlation, scatter = moments(weight, residual, level, blocks)
    if blocks:
        # Their order need not be that of time.
        return white_noise(weight, max(sigma, 1e-150))
    kept = correlation if correlation <= MOST else 0.0
    return Noise(weight, np.array(max(sigma, 1e-150)), np.array(kept), np.array(scatter))


def misfit_noise(
    weight: np.ndarray, residual: np.ndarray, level: np.ndarray, blocks: bool
) -> Noise:
    """White, each point for as much as it tells of the mean of its run.

    For a residual that is what the law lacks more than noise: were the levels of runs free, a fit
    could follow the shape within runs and miss every level.
    """
    sigma, correlation, scatter = moments(weight, residual, level, blocks)
    levels = scatter**2 * np.sum((level * weight) ** 2) / np.sum((weight > 0).any(1))
    spread = sigma**2 * (1 + correlation) / (1 - correlation) + levels
    return white_noise(weight, max(float(np.sqrt(spread)), 1e-150))


def moments(weight: np.ndarray, residual: np.ndarray, level: np.ndarray, blocks: bool) -> Moments:
    """From the residual and the adhesion predicted, both [runs, points].

    Each run's own factor on adhesion is taken out first; sigma and the lag-one correlation are
    of what is left, and the variance of the factors beyond what sigma explains is that of the
    runs. `weight` is the relative precision of each point, 0 where there is none. Blocks of one
    run have no factors of their own: sigma is then of the residual as it is.
    """
    inside = weight > 0
    factor, size, left = _levels(weight, residual, level)
    raw = _correlation(weight, left)
    if blocks:
        squares = np.where(inside, residual * weight, 0.0) ** 2
        return Moments(float(np.sqrt(squares.sum() / max(inside.sum(), 1))), raw, 0.0)
    used = inside.any(1)
    variance = float((left**2).sum() / max(inside.sum() - used.sum(), 1))
    known = variance * (1 + raw) / (1 - raw) / size[used]
    scatter = float(np.sum(factor[used] ** 2) / max(used.sum() - 1, 1) - known.mean())
    return Moments(float(np.sqrt(variance)), raw, float(np.sqrt(max(scatter, 0.0))))


def _levels(
    weight: np.ndarray, residual: np.ndarray, level: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Each run's own factor, its precision, both [runs], and the weighted residual without it."""
    inside = weight > 0
    scaled, direction = residual * weight, level * weight
    size = np.maximum((direction**2).sum(1), 1e-300)
    factor = np.where(inside.any(1), (scaled * direction).sum(1) / size, 0.0)
    return factor, size, np.where(inside, scaled - factor[:, None] * direction, 0.0)


def _correlation(weight: np.ndarray, left: np.ndarray) -> float:
    inside = weight > 0
    used = inside.any(1)
    length = inside.sum() / max(used.sum(), 1)
    if length < _SHORT:
        return 0.0
    both = inside[:, 1:] & inside[:, :-1]
    variance = float((left**2).sum() / max(inside.sum() - used.sum(), 1))
    product = float((left[:, 1:] * left[:, :-1]).sum() / max(both.sum(), 1))
    # What the level of each run takes out biases the correlation down by about (1 + 3r)/n.
    raw = (product / max(variance, 1e-300) + 1 / length) / (1 - 3 / length)
    return float(np.clip(raw, 0.0, 0.995))
