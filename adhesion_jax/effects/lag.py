from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect
from adhesion_jax.effects.cause import Changing, Remembering, now
from adhesion_jax.effects.history import Filtered, filtered, has_history, lagged
from adhesion_jax.effects.planting import CleanRuns, Plan, by_its_formula, planted

_SOURCE = "measuring chain"


class Lag(Changing, Remembering):
    """A first-order low-pass in the force signal. Source: any filtered signal."""

    time_constant: Scalar

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "time_constant": Parameter("s", 0.0, 20.0, "time constant of the filter", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("time_constant",)
    REFERENCES: ClassVar[Mapping[str, str]] = {}
    NEEDS: ClassVar[tuple[str, ...]] = ("time_s",)
    ORDER: ClassVar[int] = 2
    SENTENCE: ClassVar[str] = "The adhesion signal passes a first-order filter."
    FORMULA: ClassVar[str] = "T dmu/dt + mu = mu_steady, T in s"
    PHRASE: ClassVar[str] = "a lag of the adhesion signal"
    FAMILY: ClassVar[str] = "in time"
    RESTS_ON: ClassVar[tuple[str, ...]] = ("time_s",)
    SAME_AS: ClassVar[tuple[str, ...]] = ()
    SEEN_IN: ClassVar[tuple[str, ...]] = ("base_adhesion_change", "slip_size_change")
    DRIVEN_BY: ClassVar[str] = "slip_ratio"

    def after(
        self,
        adhesion: Float[Array, "*shape"],
        slip: Float[Array, "*shape"],
        conditions: Conditions,
    ) -> Float[Array, "*shape"]:
        if not has_history(conditions):
            return adhesion
        return lagged(adhesion, jnp.asarray(self.time_constant), conditions)

    def init(
        self, adhesion: Float[Array, ""], slip: Float[Array, ""], conditions: Conditions
    ) -> Any:
        return Filtered(now(conditions), adhesion, adhesion)

    def step(
        self,
        memory: Any,
        adhesion: Float[Array, ""],
        slip: Float[Array, ""],
        conditions: Conditions,
    ) -> tuple[Any, Float[Array, ""]]:
        memory = filtered(memory, adhesion, self.time_constant, now(conditions))
        return memory, memory.value

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [cls(time_constant=time) for time in (0.05, 0.2, 0.6, 1.5)]

    @classmethod
    def planted(cls, runs: CleanRuns, phase: float, generator: np.random.Generator) -> Plan:
        return by_its_formula(lambda time: cls(time_constant=time), 15.0, runs)

    @classmethod
    def planted_otherwise(cls, runs: CleanRuns, generator: np.random.Generator) -> Plan:
        """Two filters of half the time constant, one after the other."""

        def twice(adhesion: np.ndarray, amount: float) -> np.ndarray:
            return runs.lagged(runs.lagged(adhesion, amount / 2), amount / 2)

        return Plan(lambda a: planted(a, 2, after=lambda adhesion: twice(adhesion, a)), 10.0)
