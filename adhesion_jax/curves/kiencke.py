"""Kiencke's curve."""

from collections.abc import Sequence
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from adhesion_jax.curves.base import SLIP_LIMIT, Conditions, Curve, Parameter, Peak, Scalar, Signal

_SOURCE = "Kiencke and Daiss 1994; Qian et al. 2024, Eq. 1"


class Kiencke(Curve):
    """mu(l) = a0 l / (1 + p1 |l| + p2 l^2), l the slip ratio.

    Peak at l_m = 1/sqrt(p2), mu_m = a0 / (p1 + 2 sqrt(p2)); there is none where p2 is too small
    for l_m to lie in the range, or where the denominator has a root (p1 <= -2 sqrt(p2)).
    The initial slope a0 is known in Qian et al. 2024; free it where it is not.
    Source: Qian et al. 2024, Eq. 1 and 2 (whose radicals are lost in some prints).

    Attributes:
        a0: initial slope.
        p1: bend of the rise.
        p2: inverse square of the slip at the peak.
        free: the names of the parameters that are fitted.
    """

    a0: Scalar
    p1: Scalar
    p2: Scalar
    free: tuple[str, ...] = eqx.field(default=("p1", "p2"), static=True)

    PARAMETERS: ClassVar = {
        "a0": Parameter("1", 0.1, 2000.0, "initial slope", _SOURCE),
        # From 0 on the denominator has no root, whatever p2 is.
        "p1": Parameter("1", 0.0, 5000.0, "bend of the rise", _SOURCE),
        "p2": Parameter("1", 1e-3, 1e6, "inverse square of the slip at the peak", _SOURCE),
    }
    NEEDS = ()
    AUTOMATIC = True

    @classmethod
    def starts(cls, top: float) -> Sequence[Sequence[float]]:
        # Peak at slip l: p2 = 1/l^2, p1 = 1/l, a0 = top (p1 + 2/l).
        return [(3 * top / at, 1 / at, at**-2) for at in (0.015, 0.05, 0.15)]

    def __call__(self, slip: Signal, conditions: Conditions) -> Signal:
        size = jnp.abs(slip)
        return self.a0 * slip / (1 + self.p1 * size + self.p2 * size**2)

    def peak(self, conditions: Conditions, slip_limit: Scalar = SLIP_LIMIT) -> Peak:
        inside = self.p2 * jnp.square(slip_limit) >= 1
        root = jnp.sqrt(jnp.where(inside, self.p2, 1.0))
        slip = jnp.where(inside, 1 / root, jnp.asarray(slip_limit, dtype=float))
        found = inside & (self.p1 > -2 * root)
        return Peak(slip, self(slip, conditions), found)
