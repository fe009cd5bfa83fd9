"""The contact heats and softens: adhesion falls with friction power."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect

_SOURCE = "Ertz and Knothe 2002, Wear 253, 498-508"


class ContactHeating(Effect):
    """mu (1 - k |mu| v_s/sqrt(V)), v_s = |l| V the slip velocity and V the vehicle speed in m/s.

    The flash temperature is mu p0 v_s sqrt(a/V); pressure p0 and half axis a are in k.
    Source: Ertz and Knothe 2002, Wear 253, 498-508.
    """

    k: Scalar

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "k": Parameter("sqrt(s/m)", -2.0, 20.0, "relative fall with heating", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("k",)
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
        speed = jnp.maximum(conditions["vehicle_speed_mps"], 1e-3)
        heating = jnp.abs(adhesion) * jnp.abs(slip) * jnp.sqrt(speed)
        return adhesion * jnp.maximum(1 - self.k * heating, 0.0)

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [cls(k=0.1)]
