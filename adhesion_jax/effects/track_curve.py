"""Curves cost adhesion."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect

_SOURCE = "Iwnicki 2006, Handbook of Railway Vehicle Dynamics"


class CurveOfTrack(Effect):
    """mu (1 - k |kappa|), kappa the curvature of the track in 1/m.

    Source: Iwnicki 2006, Handbook of Railway Vehicle Dynamics, chapter 4.
    """

    k: Scalar

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "k": Parameter("m", -300.0, 300.0, "relative loss a unit of curvature", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("k",)
    REFERENCES: ClassVar[Mapping[str, str]] = {}
    NEEDS: ClassVar[tuple[str, ...]] = ("curvature_per_m",)
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
        return adhesion * jnp.maximum(1 - self.k * jnp.abs(conditions["curvature_per_m"]), 0.0)

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [cls(k=5.0)]
