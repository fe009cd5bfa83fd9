"""A curve whose shape is known, and whose height and slip are not."""

from collections.abc import Sequence
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from adhesion_jax.curves.base import SLIP_LIMIT, Conditions, Curve, Parameter, Peak, Scalar, Signal

_SOURCE = "Pacejka 2012, Tire and Vehicle Dynamics, section 4.2 (similarity method)"


class Similar(Curve):
    """mu(l) = level shape(l/stretch), `shape` a curve that depends on the slip alone.

    An exponential curve of which b/a is known, and no more, is such a one: of shape
    exp(-l) - exp(-b/a l), with c the level and 1/a the stretch.
    Peak at `stretch` times the slip of that of the shape, `level` times as high.
    """

    shape: Curve
    level: Scalar
    stretch: Scalar
    free: tuple[str, ...] = eqx.field(default=("level", "stretch"), static=True)

    PARAMETERS: ClassVar = {
        "level": Parameter("1", 1e-4, 1e3, "adhesion, over that of the shape", _SOURCE),
        "stretch": Parameter("1", 1e-4, 1e4, "slip, over that of the shape", _SOURCE),
    }
    NEEDS = ()
    AUTOMATIC = False

    @classmethod
    def starts(cls, top: float) -> Sequence[Sequence[float]]:
        return [(1.0, stretch) for stretch in (0.3, 1.0, 3.0)]

    def __call__(self, slip: Signal, conditions: Conditions) -> Signal:
        return self.level * self.shape(slip / self.stretch, conditions)

    def peak(self, conditions: Conditions, slip_limit: Scalar = SLIP_LIMIT) -> Peak:
        slip, adhesion, found = self.shape.peak(conditions, jnp.asarray(slip_limit) / self.stretch)
        return Peak(self.stretch * slip, self.level * adhesion, found)
