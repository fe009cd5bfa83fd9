"""The difference of two exponentials."""

from collections.abc import Sequence
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from adhesion_jax.curves.base import SLIP_LIMIT, Conditions, Curve, Parameter, Peak, Scalar, Signal

_SOURCE = "Uyulan, Gokasan and Bogosyan 2018"


class Exponential(Curve):
    """mu(s) = c (exp(-a s) - exp(-b s)), s the slip (ratio or velocity), odd in s.

    The source writes two levels, c exp(-a s) - d exp(-b s), but adhesion vanishes at rest only
    for c = d, as on every surface it lists. a and b are per unit of slip, b > a.
    Peak at s_m = ln(b/a)/(b - a); there is none where it lies beyond the largest slip.
    """

    a: Scalar
    b: Scalar
    c: Scalar
    free: tuple[str, ...] = eqx.field(default=("a", "b", "c"), static=True)

    PARAMETERS: ClassVar = {
        "a": Parameter("1/slip", 1e-4, 100.0, "decay beyond the peak", _SOURCE),
        "b": Parameter("1/slip", 0.1, 5000.0, "steepness of the rise", _SOURCE),
        "c": Parameter("1", 0.001, 5.0, "level of the plateau", _SOURCE),
    }
    NEEDS = ()
    AUTOMATIC = True

    @classmethod
    def starts(cls, top: float) -> Sequence[Sequence[float]]:
        return [(2.0, steep, 1.2 * top) for steep in (25.0, 70.0, 250.0)]

    def __call__(self, slip: Signal, conditions: Conditions) -> Signal:
        size = jnp.abs(slip)
        difference = jnp.exp(-self.a * size) - jnp.exp(-self.b * size)
        return self.c * jnp.sign(slip) * difference

    def peak(self, conditions: Conditions, slip_limit: Scalar = SLIP_LIMIT) -> Peak:
        rises = jnp.asarray(self.b > self.a)
        gap = jnp.where(rises, self.b - self.a, 1.0)
        # log1p keeps the limit b -> a, s_m -> 1/a, exact.
        stationary = jnp.where(rises, jnp.log1p(gap / self.a) / gap, 0.0)
        slip = jnp.clip(stationary, 0.0, slip_limit)
        found = rises & (stationary <= slip_limit)
        return Peak(slip, self(slip, conditions), found)
