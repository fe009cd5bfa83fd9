"""The contact takes a distance, not a time, to build up force."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect
from adhesion_jax.effects.history import has_history, lagged

_SOURCE = "Pacejka 2012, Tire and Vehicle Dynamics"


class Relaxation(Effect):
    """(s/V) dmu/dt + mu = mu_steady, s the relaxation length in m, V the vehicle speed in m/s.

    Source: Pacejka 2012, Tire and Vehicle Dynamics, chapter 7.
    """

    length: Scalar

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "length": Parameter("m", 0.0, 100.0, "relaxation length", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("length",)
    REFERENCES: ClassVar[Mapping[str, str]] = {}
    NEEDS: ClassVar[tuple[str, ...]] = ("vehicle_speed_mps", "time_s")
    ORDER: ClassVar[int] = 2
    SLOW: ClassVar[bool] = True

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
        if not has_history(conditions):
            return adhesion
        speed = jnp.maximum(conditions["vehicle_speed_mps"], 0.1)
        return lagged(adhesion, self.length / speed, conditions)

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [cls(length=length) for length in (0.3, 1.0, 3.0, 10.0)]
