"""The adhesion signal passes a first-order filter."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect
from adhesion_jax.effects.history import has_history, lagged

_SOURCE = "measuring chain"


class Lag(Effect):
    """T dmu/dt + mu = mu_steady, T in s.

    Source: any filtered force signal.
    """

    time_constant: Scalar

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "time_constant": Parameter("s", 0.0, 20.0, "time constant of the filter", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("time_constant",)
    REFERENCES: ClassVar[Mapping[str, str]] = {}
    NEEDS: ClassVar[tuple[str, ...]] = ("time_s",)
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
        return lagged(adhesion, jnp.asarray(self.time_constant), conditions)

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [cls(time_constant=time) for time in (0.05, 0.2, 0.6, 1.5)]
