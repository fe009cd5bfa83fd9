"""Adhesion is not the same for rising and for falling slip."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect
from adhesion_jax.effects.history import has_history, lagged, rate

_SOURCE = "Trummer et al. 2017, Wear 378:1-9"


class Hysteresis(Effect):
    """mu (1 + k h), T dh/dt + h = tanh((d|l|/dt)/s), s in 1/s, T the memory in s.

    Source: Zhang et al. 2002; Trummer et al. 2017, Wear 378, 1-9.
    """

    k: Scalar
    rate: Scalar
    memory: Scalar

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "k": Parameter("1", -0.9, 0.9, "relative difference, rising less steady", _SOURCE),
        "rate": Parameter("1/s", 1e-05, 10.0, "slip rate of full effect", _SOURCE),
        "memory": Parameter("s", 0.0, 5.0, "time it takes to turn", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("k",)
    REFERENCES: ClassVar[Mapping[str, str]] = {}
    NEEDS: ClassVar[tuple[str, ...]] = ("time_s",)
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
        if not has_history(conditions):
            return adhesion
        direction = jnp.tanh(rate(jnp.abs(slip), conditions) / self.rate)
        return adhesion * (1 + self.k * lagged(direction, jnp.asarray(self.memory), conditions))

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [cls(k=0.03, rate=rate, memory=0.02) for rate in (0.001, 0.005, 0.02, 0.1)]
