"""The wheel radius is not what the slip was calculated with."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect

_SOURCE = "odometry"


class SlipBias(Effect):
    """mu(l + e sign(l)), e the bias of the slip ratio.

    Source: any odometry; Burckhardt's curve changes as by a torque offset.
    """

    bias: Scalar

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "bias": Parameter("1", -0.05, 0.05, "slip ratio that is missing", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("bias",)
    REFERENCES: ClassVar[Mapping[str, str]] = {}
    NEEDS: ClassVar[tuple[str, ...]] = ()
    ORDER: ClassVar[int] = 0

    def before(
        self, slip: Float[Array, "*shape"], conditions: Conditions
    ) -> Float[Array, "*shape"]:
        return slip + self.bias * jnp.sign(slip)

    def after(
        self,
        adhesion: Float[Array, "*shape"],
        slip: Float[Array, "*shape"],
        conditions: Conditions,
    ) -> Float[Array, "*shape"]:
        return adhesion

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [cls(bias=5e-4)]
