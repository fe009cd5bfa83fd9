"""Measurement noise of the adhesion signal."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

_OUTLIER_FACTOR = 10.0


def draw_noise(
    key: PRNGKeyArray, shape: tuple[int, ...], sigma: float, outliers: float
) -> Float[Array, "*shape"]:
    """Independent N(0, sigma^2); a share `outliers` of the points has ten times the sigma."""
    normal_key, outlier_key = jax.random.split(key)
    noise = sigma * jax.random.normal(normal_key, shape)
    if outliers == 0.0:
        return noise
    is_outlier = jax.random.bernoulli(outlier_key, outliers, shape)
    return jnp.where(is_outlier, _OUTLIER_FACTOR * noise, noise)
