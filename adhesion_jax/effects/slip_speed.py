"""Adhesion falls with slip velocity: Burckhardt's c4."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect

_SOURCE = "Burckhardt 1993; He et al. 2018, Eq. 4"


class SlipSpeed(Effect):
    """mu exp(-c4 |l| V), l the slip ratio, V the vehicle speed in m/s.

    c4 is about .02 to .04 s/m. Source: Burckhardt 1993; He et al. 2018, Eq. 4.
    """

    c4: Scalar

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "c4": Parameter("s/m", -0.2, 2.0, "fall with slip velocity", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("c4",)
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
        return adhesion * jnp.exp(-self.c4 * jnp.abs(slip) * conditions["vehicle_speed_mps"])

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [cls(c4=0.01)]
