"""The noise of a campaign: sigma and AR(1) within a run, a random level from run to run."""

import numpy as np

from adhesion_jax.discovery.program import Noise

#: An autocorrelation beyond this is mostly what the law still lacks: whitening by more would leave
#: only the fastest changes to judge by, and a curve that fits them alone.
_MOST = 0.7


def white_noise(points: np.ndarray, sigma: float) -> Noise:
    """No correlation and no scatter of the runs."""
    return Noise(points, np.array(sigma), np.array(0.0), np.array(0.0))


def estimate_noise(weight: np.ndarray, residual: np.ndarray, level: np.ndarray) -> Noise:
    """From the residual and the adhesion predicted, both [runs, points], by moments.

    Each run's own factor on adhesion is taken out first; sigma and the lag-one correlation are
    of what is left, and the variance of the factors beyond what sigma explains is that of the
    runs. `weight` is the relative precision of each point, 0 where there is none.
    """
    inside = weight > 0
    scaled, direction = residual * weight, level * weight
    size = np.maximum((direction**2).sum(1), 1e-300)
    used = inside.any(1)
    factor = np.where(used, (scaled * direction).sum(1) / size, 0.0)
    left = np.where(inside, scaled - factor[:, None] * direction, 0.0)
    freedom = max(inside.sum() - used.sum(), 1)
    variance = float((left**2).sum() / freedom)
    both = inside[:, 1:] & inside[:, :-1]
    product = float((left[:, 1:] * left[:, :-1]).sum() / max(both.sum(), 1))
    # What the level of each run takes out biases the correlation down by about (1 + 3r)/n.
    length = max(inside.sum() / max(used.sum(), 1), 4.0)
    raw = product / max(variance, 1e-300)
    correlation = float(np.clip((raw + 1 / length) / (1 - 3 / length), 0.0, _MOST))
    known = variance * (1 + correlation) / (1 - correlation) / size[used]
    scatter = float(np.sum(factor[used] ** 2) / max(used.sum() - 1, 1) - known.mean())
    if length < 5:
        correlation = 0.0
    return Noise(
        weight,
        np.array(np.sqrt(max(variance, 1e-300))),
        np.array(correlation),
        np.array(np.sqrt(max(scatter, 0.0))),
    )
