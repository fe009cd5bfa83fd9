"""Polach's creep force law in closed form, with Coulomb and with falling friction."""

from collections.abc import Sequence
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.curves.base import SLIP_LIMIT, Conditions, Curve, Parameter, Peak, Scalar, Signal

_SOURCE = "Polach 2005, Wear 258, 992-1000"


def saturation(
    slip: Float[Array, "*shape"],
    friction: Float[Array, "*shape"] | Scalar,
    stiffness: Float[Array, "*shape"] | Scalar,
    k_a: Float[Array, "*shape"] | Scalar,
    k_s: Float[Array, "*shape"] | Scalar,
) -> Float[Array, "*shape"]:
    """Mu = (2 mu_f/pi) (kA e/(1 + (kA e)^2) + atan(kS e)), e = pi C |l| / (4 mu_f), odd in l.

    e is the gradient of the tangential stress in the area of adhesion, C the adhesion per unit
    of slip at vanishing slip with kA = kS = 1 (for other values the slope is C (kA + kS)/2).
    Source: Polach 2005.
    """
    gradient = jnp.pi * stiffness * jnp.abs(slip) / (4 * friction)
    adhering = k_a * gradient / (1 + (k_a * gradient) ** 2)
    return jnp.sign(slip) * (2 * friction / jnp.pi) * (adhering + jnp.arctan(k_s * gradient))


_PARAMETERS = {
    "mu0": Parameter("1", 0.001, 2.0, "friction coefficient at rest", _SOURCE),
    "stiffness": Parameter("1", 0.1, 5000.0, "adhesion per unit of slip at rest", _SOURCE),
}


class Polach(Curve):
    """Polach's law with Coulomb friction, kA = kS = 1: adhesion rises to mu0 and never falls.

    It has no peak at any finite slip. Source: Polach 2005.
    """

    mu0: Scalar
    stiffness: Scalar
    free: tuple[str, ...] = eqx.field(default=("mu0", "stiffness"), static=True)

    PARAMETERS: ClassVar = _PARAMETERS
    NEEDS = ()
    AUTOMATIC = False

    @classmethod
    def starts(cls, top: float) -> Sequence[Sequence[float]]:
        return [(1.1 * top, stiffness) for stiffness in (30.0, 100.0, 400.0)]

    def __call__(self, slip: Signal, conditions: Conditions) -> Signal:
        return saturation(slip, self.mu0, self.stiffness, 1.0, 1.0)

    def peak(self, conditions: Conditions, slip_limit: Scalar = SLIP_LIMIT) -> Peak:
        # d/de [e/(1 + e^2) + atan(e)] = 2/(1 + e^2)^2 > 0: the largest adhesion is at the end.
        slip = jnp.asarray(slip_limit, dtype=float)
        return Peak(slip, self(slip, conditions), jnp.zeros((), dtype=bool))


class _Falling(Curve):
    """What the two laws share whose friction falls with the slip velocity w = |l| V.

    It falls by the factor (1 - a) exp(-b w) + a, a the share that remains at high slip velocity.
    """

    mu0: Scalar
    a: Scalar
    b: Scalar
    stiffness: Scalar
    k_s: Scalar
    free: tuple[str, ...] = eqx.field(default=("mu0", "a", "b", "stiffness", "k_s"), static=True)

    NEEDS = ("vehicle_speed_mps",)
    AUTOMATIC = True

    @classmethod
    def starts(cls, top: float) -> Sequence[Sequence[float]]:
        """Stiff and soft rises, with little and much reduction in the area of slip."""
        rises = [(stiffness, k_s) for stiffness in (40.0, 150.0) for k_s in (0.3, 0.9)]
        return [(1.4 * top, 0.5, 0.5, stiffness, k_s) for stiffness, k_s in rises]

    def left(self, slip: Signal, conditions: Conditions) -> Signal:
        """The share of friction that is left."""
        slip_velocity = jnp.abs(slip) * conditions["vehicle_speed_mps"]
        return (1 - self.a) * jnp.exp(-self.b * slip_velocity) + self.a


_OF_FALLING = {
    **_PARAMETERS,
    "a": Parameter("1", 0.0, 1.0, "share of friction left at high slip velocity", _SOURCE),
    "b": Parameter("s/m", 0.01, 20.0, "decay of friction with slip velocity", _SOURCE),
    # With a much smaller kS adhesion has a second peak near slip 0.
    "k_s": Parameter("1", 0.1, 1.0, "reduction in the area of slip", _SOURCE),
}


class PolachFalling(_Falling):
    """Polach's law with friction that falls with the slip velocity: mu_f = mu0 (what is left).

    Only the products kA C and kS C act on adhesion, so kA is one by default and C and kS are free.
    The peak is found numerically. Source: Polach 2005.
    """

    k_a: Scalar = 1.0

    PARAMETERS: ClassVar = {
        **_OF_FALLING,
        "k_a": Parameter("1", 0.01, 1.0, "reduction in the area of adhesion", _SOURCE),
    }

    def __call__(self, slip: Signal, conditions: Conditions) -> Signal:
        friction = self.mu0 * self.left(slip, conditions)
        return saturation(slip, friction, self.stiffness, self.k_a, self.k_s)


class PolachScaled(_Falling):
    """Polach's law with Coulomb friction, the whole of it falling: mu = (what is left) Polach(l).

    Unlike in PolachFalling the stress gradient is that of the friction at rest, so that the rise
    keeps its steepness where friction has fallen. Which of the two a measurement follows cannot be
    known beforehand. After Polach 2005.
    """

    PARAMETERS: ClassVar = _OF_FALLING

    def __call__(self, slip: Signal, conditions: Conditions) -> Signal:
        whole = saturation(slip, self.mu0, self.stiffness, 1.0, self.k_s)
        return self.left(slip, conditions) * whole
