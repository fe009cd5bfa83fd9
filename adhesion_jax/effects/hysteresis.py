from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect
from adhesion_jax.effects.cause import Remembering, Scaling, now
from adhesion_jax.effects.history import Filtered, filtered, has_history, lagged, rate
from adhesion_jax.effects.planting import CleanRuns, Plan, by_factor, by_its_formula

_SOURCE = "Trummer et al. 2017, Wear 378:1-9"


class Hysteresis(Scaling, Remembering):
    """Source: Zhang et al. 2002; Trummer et al. 2017, Wear 378, 1-9."""

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
    SENTENCE: ClassVar[str] = "Adhesion differs between rising and falling slip."
    FORMULA: ClassVar[str] = (
        "mu (1 + k h), T dh/dt + h = tanh((d|l|/dt)/s), s in 1/s, T the memory in s"
    )
    PHRASE: ClassVar[str] = "hysteresis"
    FAMILY: ClassVar[str] = "in time"
    RESTS_ON: ClassVar[tuple[str, ...]] = ("slip_ratio", "time_s")
    SAME_AS: ClassVar[tuple[str, ...]] = ()
    SEEN_IN: ClassVar[tuple[str, ...]] = ("base_adhesion_change", "slip_size_change")
    DRIVEN_BY: ClassVar[str] = "slip_ratio"

    def factor(self, slip: Float[Array, "*shape"], conditions: Conditions) -> Float[Array, "..."]:
        if not has_history(conditions):
            return jnp.ones_like(slip)
        direction = jnp.tanh(rate(jnp.abs(slip), conditions) / self.rate)
        return 1 + self.k * lagged(direction, jnp.asarray(self.memory), conditions)

    def init(
        self, adhesion: Float[Array, ""], slip: Float[Array, ""], conditions: Conditions
    ) -> Any:
        nothing = jnp.zeros(())
        return Filtered(now(conditions), nothing, nothing), jnp.abs(slip)

    def step(
        self,
        memory: Any,
        adhesion: Float[Array, ""],
        slip: Float[Array, ""],
        conditions: Conditions,
    ) -> tuple[Any, Float[Array, ""]]:
        turning, before = memory
        passed = now(conditions) - turning.time
        change = (jnp.abs(slip) - before) / jnp.where(passed > 0, passed, jnp.inf)
        turning = filtered(turning, jnp.tanh(change / self.rate), self.memory, now(conditions))
        return (turning, jnp.abs(slip)), adhesion * (1 + self.k * turning.value)

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [cls(k=0.03, rate=rate, memory=0.02) for rate in (0.001, 0.005, 0.02, 0.1)]

    @classmethod
    def planted(cls, runs: CleanRuns, phase: float, generator: np.random.Generator) -> Plan:
        rate = generator.uniform(0.01, 0.04)
        return by_its_formula(lambda k: cls(k=k, rate=rate, memory=0.0), 0.9, runs)

    @classmethod
    def planted_otherwise(cls, runs: CleanRuns, generator: np.random.Generator) -> Plan:
        """1 + a h, h the last direction in which slip went, forgotten over .3 s."""
        memory = runs.lagged(np.sign(runs.rate(np.abs(runs.slip))), 0.3)
        return by_factor(lambda a: 1 + a * memory, 0.9)
