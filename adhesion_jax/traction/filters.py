"""Steps that parts of the loop share: a lag, a band, and derivatives by sliding modes."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.traction.signals import PerAxle, Setting

#: The lags in s whose difference is the band. It is whole and in phase at 30 Hz, the slowest twist
#: of a wheelset, which a late torque drives most, and 70 % of it at 12 and 74 Hz.
_FAST, _SLOW = 0.00375, 0.0075

#: The memories in s of how strongly a signal swings, some turns, so that one jump is no swing, and
#: of its level; and the root mean square that is strong, as a share of that level.
_MEMORY, _LEVEL, _STRONG = 0.1, 0.05, 0.4


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


class Swing(NamedTuple):
    """What of a signal swings like an axle that twists, and how strongly, from lags of it."""

    fast: PerAxle
    slow: PerAxle
    level: PerAxle
    energy: PerAxle  # mean square of the band

    @staticmethod
    def still(signal: PerAxle) -> "Swing":
        """Before the first period, from zero, of as many axles."""
        return Swing(*4 * (jnp.zeros_like(signal),))

    @property
    def band(self) -> PerAxle:
        """That part of the signal, in phase and in full at 30 Hz."""
        return (_SLOW + _FAST) / (_SLOW - _FAST) * (self.fast - self.slow)

    def strength(self, least: Setting) -> PerAxle:
        """From 0 to 1, and 1/2 where the band is strong for the level, taken as `least` or more."""
        strong = self.energy / (_STRONG * jnp.maximum(jnp.abs(self.level), least)) ** 2
        return strong**2 / (1 + strong**2)

    def after(self, signal: PerAxle, period: float) -> "Swing":
        """After a period of a constant signal."""
        swing = self._replace(
            fast=lagged(self.fast, signal, _FAST, period),
            slow=lagged(self.slow, signal, _SLOW, period),
            level=lagged(self.level, signal, _LEVEL, period),
        )
        return swing._replace(energy=lagged(self.energy, swing.band**2, _MEMORY, period))
