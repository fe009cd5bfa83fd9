"""The adhesion signal comes later than the slip signal."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect
from adhesion_jax.effects.history import has_history, shifted

_SOURCE = "measuring chain"


class Delay(Effect):
    """mu(t - d), d in s; negative where the slip signal is the late one.

    Source: any measuring chain with separate channels.
    """

    delay: Scalar

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "delay": Parameter("s", -2.0, 5.0, "time by which adhesion is late", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("delay",)
    REFERENCES: ClassVar[Mapping[str, str]] = {}
    NEEDS: ClassVar[tuple[str, ...]] = ("time_s",)
    ORDER: ClassVar[int] = 2

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
        return shifted(adhesion, jnp.asarray(self.delay), conditions)

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [cls(delay=delay) for delay in (0.05, 0.15, 0.4, 1.0)]
