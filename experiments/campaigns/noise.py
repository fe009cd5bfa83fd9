"""The noise of measured runs, drawn."""

import numpy as np
from jaxtyping import Float
from scipy.signal import lfilter

from adhesion_jax.inference.noise import RunNoise


def noise_of_runs(
    noise: RunNoise, mean: Float[np.ndarray, "*sets runs rows"], generator: np.random.Generator
) -> Float[np.ndarray, "*sets runs rows"]:
    """A residual of each run whose curve is `mean`, without what the noise of the slip makes."""
    e = noise.sigma * _autoregressive(noise.autocorrelation, mean.shape, generator)
    level = noise.run_scatter * generator.standard_normal((*mean.shape[:-1], 1))
    if noise.slow_level:
        slow = float(np.exp(-1 / noise.slow_rows))
        level = level + noise.slow_level * _autoregressive(slow, mean.shape, generator)
    return e + level * mean


def _autoregressive(
    r: float, shape: tuple[int, ...], generator: np.random.Generator
) -> Float[np.ndarray, "*sets runs rows"]:
    """Of variance 1, stationary from its first row, with the correlation r^|lag|."""
    fresh = generator.standard_normal(shape)
    fresh[..., 1:] *= np.sqrt(1 - r**2)
    found: np.ndarray = lfilter([1.0], [1.0, -r], fresh, axis=-1)
    return found
