"""Steps that parts of the loop share: a lag, and derivatives by sliding modes."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.traction.signals import PerAxle, Setting


def lagged(before: PerAxle, signal: PerAxle, time_constant: Setting, period: float) -> PerAxle:
    """A first-order lag over a period of a constant signal: y + (1 - exp(-period/T)) (s - y)."""
    return before - jnp.expm1(-period / jnp.asarray(time_constant)) * (signal - before)


def pull(error: PerAxle, gain: Float[Array, "..."]) -> PerAxle:
    """1.5 sqrt(G) |e|^(1/2) sgn e, by which a second-order sliding mode follows a signal."""
    return 1.5 * jnp.sqrt(gain * jnp.abs(error)) * jnp.sign(error)


class Differentiator(NamedTuple):
    """A signal as it is followed, and its derivative per second.

    By a second-order sliding mode, after Levant 1998, Automatica 34.
    """

    value: PerAxle
    rate: PerAxle

    def after(self, signal: PerAxle, gain: Float[Array, "..."], period: float) -> "Differentiator":
        """With dx = r + 1.5 sqrt(G) |e|^(1/2) sgn e, dr = 1.1 G sgn e, e = signal - x.

        r is taken at the end of the step, as in the observers of this kind.
        """
        error = signal - self.value
        rate = self.rate + period * 1.1 * gain * jnp.sign(error)
        return Differentiator(self.value + period * (rate + pull(error, gain)), rate)
