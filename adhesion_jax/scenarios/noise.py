"""Measurement noise of the adhesion signal."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from adhesion_jax.options import Autocorrelation, Outliers, Sigma

_OUTLIER_FACTOR = 10.0


class Noise(eqx.Module):
    """N(0, sigma^2), first-order autoregressive: e(k) = r e(k-1) + sqrt(1 - r^2) w(k), w white.

    r is `autocorrelation`, so that samples j apart have the correlation r^j. A share `outliers` of
    the samples, independent of the noise, has ten times as much of it.
    """

    sigma: Sigma = eqx.field(default=0.01, static=True)
    outliers: Outliers = eqx.field(default=0.0, static=True)
    autocorrelation: Autocorrelation = eqx.field(default=0.0, static=True)

    def draw(self, key: PRNGKeyArray, shape: tuple[int, ...]) -> Float[Array, "*shape"]:
        """Neighbours are those along the last axis; what differs in others is independent."""
        normal_key, outlier_key = jax.random.split(key)
        noise = self.sigma * self.coloured(jax.random.normal(normal_key, shape))
        if self.outliers == 0.0:
            return noise
        is_outlier = jax.random.uniform(outlier_key, shape) < self.outliers
        return jnp.where(is_outlier, _OUTLIER_FACTOR * noise, noise)

    def coloured(self, white: Float[Array, "*rows points"]) -> Float[Array, "*rows points"]:
        """White noise of variance 1 as autoregressive noise of the same variance, stationary."""
        r = self.autocorrelation
        if r == 0.0:
            return white
        fresh = jnp.sqrt(1 - r**2) * white
        fresh = fresh.at[..., 0].set(white[..., 0])

        def joined(first: tuple[Array, Array], then: tuple[Array, Array]) -> tuple[Array, Array]:
            return first[0] * then[0], then[0] * first[1] + then[1]

        return jax.lax.associative_scan(joined, (jnp.full_like(fresh, r), fresh), axis=-1)[1]

    def whitened(self, signal: Float[Array, "*rows points"]) -> Float[Array, "*rows points"]:
        """The inverse of `coloured`: what makes neighbours of such noise independent."""
        r = self.autocorrelation
        if r == 0.0:
            return signal
        fresh = (signal[..., 1:] - r * signal[..., :-1]) / jnp.sqrt(1 - r**2)
        return jnp.concatenate([signal[..., :1], fresh], axis=-1)
