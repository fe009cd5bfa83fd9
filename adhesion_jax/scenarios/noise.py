"""Measurement noise of the adhesion signal."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from adhesion_jax.scenarios.draws import normal, uniform

_OUTLIER_FACTOR = 10.0


def draw_noise(
    key: PRNGKeyArray, shape: tuple[int, ...], sigma: float, outliers: float, lag_one: float = 0.0
) -> Float[Array, "*shape"]:
    """N(0, sigma^2), of correlation `lag_one` between neighbours along the last axis.

    A share `outliers` of the points, independent of the noise, has ten times as much of it.
    """
    normal_key, outlier_key = jax.random.split(key)
    noise = sigma * coloured(normal(normal_key, shape), lag_one)
    if outliers == 0.0:
        return noise
    is_outlier = uniform(outlier_key, shape) < outliers
    return jnp.where(is_outlier, _OUTLIER_FACTOR * noise, noise)


def coloured(white: Float[Array, "*rows points"], lag_one: float) -> Float[Array, "*rows points"]:
    """White noise as first-order autoregressive noise of the same variance, stationary.

    e(0) = w(0), e(k) = r e(k-1) + sqrt(1 - r^2) w(k), r = lag_one (|r| < 1), so that points j
    apart have the correlation r^j.
    """
    if lag_one == 0.0:
        return white
    fresh = jnp.sqrt(1 - lag_one**2) * white
    fresh = fresh.at[..., 0].set(white[..., 0])

    def joined(first: tuple[Array, Array], then: tuple[Array, Array]) -> tuple[Array, Array]:
        return first[0] * then[0], then[0] * first[1] + then[1]

    kept = jnp.full_like(fresh, lag_one)
    return jax.lax.associative_scan(joined, (kept, fresh), axis=-1)[1]


def whitened(signal: Float[Array, "*rows points"], lag_one: float) -> Float[Array, "*rows points"]:
    """The inverse of `coloured`: what makes neighbours of such noise independent."""
    if lag_one == 0.0:
        return signal
    fresh = (signal[..., 1:] - lag_one * signal[..., :-1]) / jnp.sqrt(1 - lag_one**2)
    return jnp.concatenate([signal[..., :1], fresh], axis=-1)
