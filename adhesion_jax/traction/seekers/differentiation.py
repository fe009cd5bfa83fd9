"""A derivative by a second-order sliding mode, after Levant 1998, Automatica 34."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float


class Differentiator(NamedTuple):
    """A signal as it is followed, and its derivative per second."""

    value: Float[Array, " axles"]
    rate: Float[Array, " axles"]

    def after(
        self, signal: Float[Array, " axles"], gain: Float[Array, "..."], period: float
    ) -> "Differentiator":
        """With dx = r + 1.5 sqrt(G) |e|^(1/2) sgn e, dr = 1.1 G sgn e, e = signal - x.

        r is taken at the end of the step, as in the observers of this kind.
        """
        error = signal - self.value
        pulled = 1.5 * jnp.sqrt(gain * jnp.abs(error)) * jnp.sign(error)
        rate = self.rate + period * 1.1 * gain * jnp.sign(error)
        return Differentiator(self.value + period * (rate + pulled), rate)
