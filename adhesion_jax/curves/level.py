"""Adhesion at one slip: a level, without a curve."""

from collections.abc import Sequence
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from adhesion_jax.curves.base import SLIP_LIMIT, Conditions, Curve, Parameter, Peak, Scalar, Signal


class Level(Curve):
    """mu(l) = m sign(l): the curve for data that are all at one size of slip."""

    level: Scalar
    free: tuple[str, ...] = eqx.field(default=("level",), static=True)

    PARAMETERS: ClassVar = {
        "level": Parameter("1", 0.0, 3.0, "adhesion at that slip", "mean of the data"),
    }
    NEEDS = ()
    AUTOMATIC = False

    @classmethod
    def starts(cls, top: float) -> Sequence[Sequence[float]]:
        return [(top,)]

    def __call__(self, slip: Signal, conditions: Conditions) -> Signal:
        return self.level * jnp.where(slip < 0, -1.0, 1.0)

    def peak(self, conditions: Conditions, slip_limit: Scalar = SLIP_LIMIT) -> Peak:
        slip = jnp.asarray(slip_limit, dtype=float)
        return Peak(slip, self(slip, conditions), jnp.zeros((), dtype=bool))
