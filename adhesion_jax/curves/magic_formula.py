"""Pacejka's Magic Formula."""

from collections.abc import Sequence
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from adhesion_jax.curves.base import Conditions, Curve, Parameter, Scalar, Signal

_SOURCE = "Pacejka 2012, Tire and Vehicle Dynamics, section 4.3"


class MagicFormula(Curve):
    """mu(l) = d sin(c atan(b l - e (b l - atan(b l)))), odd in l.

    Parameters are the stiffness factor b, shape c, peak value d and curvature e; the initial
    slope is b c d. A peak needs c > 1; it is found numerically. Source: Pacejka 2012, Eq. 4.49.
    """

    b: Scalar
    c: Scalar
    d: Scalar
    e: Scalar
    free: tuple[str, ...] = eqx.field(default=("b", "c", "d", "e"), static=True)

    PARAMETERS: ClassVar = {
        "b": Parameter("1", 0.1, 5000.0, "stiffness factor", _SOURCE),
        "c": Parameter("1", 0.5, 3.0, "shape factor", _SOURCE),
        "d": Parameter("1", 0.001, 2.0, "peak value", _SOURCE),
        "e": Parameter("1", -20.0, 1.0, "curvature factor", _SOURCE),
    }
    NEEDS = ()
    AUTOMATIC = False  # its free shape absorbs real effects

    @classmethod
    def starts(cls, top: float) -> Sequence[Sequence[float]]:
        return [(steep, 1.5, top, 0.0) for steep in (10.0, 40.0, 150.0)]

    def __call__(self, slip: Signal, conditions: Conditions) -> Signal:
        stretched = self.b * slip
        bent = stretched - self.e * (stretched - jnp.arctan(stretched))
        return self.d * jnp.sin(self.c * jnp.arctan(bent))
