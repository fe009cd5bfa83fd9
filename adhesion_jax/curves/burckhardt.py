"""Burckhardt's curve in three parameters."""

from collections.abc import Sequence
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from adhesion_jax.curves.base import SLIP_LIMIT, Conditions, Curve, Parameter, Peak, Scalar, Signal

_SOURCE = "Burckhardt 1993; He et al. 2018, Eq. 5"


class Burckhardt(Curve):
    """mu(l) = c1 (1 - exp(-c2 l)) - c3 l, l the slip ratio, odd in l.

    Peak at l_m = ln(c1 c2 / c3) / c2, mu_m = c1 - (c3/c2)(1 + ln(c1 c2 / c3)); there is none
    where the curve falls from the start (c1 c2 <= c3) or rises beyond the largest slip.
    Source: He et al. 2018, Eq. 5 and 6.

    Attributes:
        c1: level of the plateau.
        c2: steepness of the rise.
        c3: fall beyond the peak.
        free: the names of the parameters that are fitted.
    """

    c1: Scalar
    c2: Scalar
    c3: Scalar
    free: tuple[str, ...] = eqx.field(default=("c1", "c2", "c3"), static=True)

    PARAMETERS: ClassVar = {
        "c1": Parameter("1", 0.001, 2.0, "level of the plateau", _SOURCE),
        "c2": Parameter("1", 0.5, 5000.0, "steepness of the rise", _SOURCE),
        "c3": Parameter("1", 0.0, 5.0, "fall beyond the peak", _SOURCE),
    }
    NEEDS = ()
    AUTOMATIC = True

    @classmethod
    def starts(cls, top: float) -> Sequence[Sequence[float]]:
        return [(1.1 * top, steep, top) for steep in (25.0, 70.0, 250.0)]

    def __call__(self, slip: Signal, conditions: Conditions) -> Signal:
        rise = 1 - jnp.exp(-self.c2 * jnp.abs(slip))
        return self.c1 * jnp.sign(slip) * rise - self.c3 * slip

    def peak(self, conditions: Conditions, slip_limit: Scalar = SLIP_LIMIT) -> Peak:
        # Kept above zero, so that value and derivative stay finite; the clip then gives the slip.
        rise, fall = jnp.maximum(self.c1 * self.c2, 1e-300), jnp.maximum(self.c3, 1e-300)
        stationary = (jnp.log(rise) - jnp.log(fall)) / self.c2
        slip = jnp.clip(stationary, 0.0, slip_limit)
        found = (stationary > 0) & (stationary <= slip_limit)
        return Peak(slip, self(slip, conditions), found)
