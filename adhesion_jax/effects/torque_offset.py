"""The force signal has an offset, such as the torque of losses."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect

_SOURCE = "measuring chain"


class TorqueOffset(Effect):
    """mu + b sign(l).

    Source: any measured driving torque.
    """

    offset: Scalar

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "offset": Parameter("1", -0.5, 0.5, "adhesion that is added", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("offset",)
    REFERENCES: ClassVar[Mapping[str, str]] = {}
    NEEDS: ClassVar[tuple[str, ...]] = ()
    ORDER: ClassVar[int] = 1

    def before(
        self, slip: Float[Array, "*shape"], conditions: Conditions
    ) -> Float[Array, "*shape"]:
        return slip

    def after(
        self,
        adhesion: Float[Array, "*shape"],
        slip: Float[Array, "*shape"],
        conditions: Conditions,
    ) -> Float[Array, "*shape"]:
        return adhesion + self.offset * jnp.sign(slip)

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [cls(offset=0.002)]
