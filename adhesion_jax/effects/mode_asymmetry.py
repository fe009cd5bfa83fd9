"""Traction and braking do not have the same adhesion."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect

_SOURCE = "Arias-Cuevas and Li 2011, Wear 271:1482-1491"


class ModeAsymmetry(Effect):
    """mu (1 + k m), m = 1 in traction, -1 in braking, 0 in coasting.

    Source: Arias-Cuevas and Li 2011, Wear 271, 1482-1491.
    """

    k: Scalar

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "k": Parameter("1", -0.9, 0.9, "half the relative difference", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("k",)
    REFERENCES: ClassVar[Mapping[str, str]] = {}
    NEEDS: ClassVar[tuple[str, ...]] = ("mode",)
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
        return adhesion * (1 + self.k * conditions["mode"])

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [cls(k=0.03)]
