"""Adhesion at one slip: a level, without a curve."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves.base import SLIP_LIMIT, Conditions, Curve, Parameter, Peak, Scalar


class Level(Curve):
    """mu(l) = m sign(l): the curve for data that are all at one size of slip."""

    level: Scalar
    free: tuple[str, ...] = eqx.field(default=("level",), static=True)

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "level": Parameter("1", 0.0, 3.0, "adhesion at that slip", "mean of the data"),
    }
    NEEDS: ClassVar[tuple[str, ...]] = ()
    AUTOMATIC: ClassVar[bool] = False

    @classmethod
    def starts(cls, top: float) -> Sequence[Sequence[float]]:
        return [(top,)]

    @classmethod
    def drawn(cls, level: float, peak: float, generator: np.random.Generator) -> Curve:
        return cls(level=level)

    def __call__(
        self, slip: Float[Array, "*shape"], conditions: Conditions
    ) -> Float[Array, "*shape"]:
        return self.level * jnp.where(slip < 0, -1.0, 1.0)

    def peak(self, conditions: Conditions, slip_limit: Scalar = SLIP_LIMIT) -> Peak:
        slip = jnp.asarray(slip_limit, dtype=float)
        return Peak(slip, self(slip, conditions), jnp.zeros((), dtype=bool))
