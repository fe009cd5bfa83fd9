"""Friction falls with slip velocity: Polach's law on any curve."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect

_SOURCE = "Polach 2005, Wear 258, 992-1000"


class FallingFriction(Effect):
    """mu (1 - d (1 - exp(-b w))), w = |l| V the slip velocity in m/s; d = 1 - A of the source.

    Source: Polach 2005, Wear 258, 992-1000 (dry A = .4, b = .6 s/m; wet A = .4, b = .2 s/m).
    """

    drop: Scalar
    b: Scalar

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "drop": Parameter("1", -0.5, 1.0, "share of friction lost at high slip velocity", _SOURCE),
        "b": Parameter("s/m", 0.02, 20.0, "decay of friction with slip velocity", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("drop",)
    REFERENCES: ClassVar[Mapping[str, str]] = {}
    NEEDS: ClassVar[tuple[str, ...]] = ("vehicle_speed_mps",)
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
        slip_velocity = jnp.abs(slip) * conditions["vehicle_speed_mps"]
        return adhesion * (1 + self.drop * jnp.expm1(-self.b * slip_velocity))

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [cls(drop=0.05, b=b) for b in (0.1, 0.3, 0.8, 2.0, 6.0)]
