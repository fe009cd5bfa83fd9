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

_SOURCE = "Pacejka 2012, Tire and Vehicle Dynamics"


class Relaxation(Changing, Remembering):
    """Source: Pacejka 2012, Tire and Vehicle Dynamics, chapter 7."""

    length: Scalar

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "length": Parameter("m", 0.0, 100.0, "relaxation length", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("length",)
    REFERENCES: ClassVar[Mapping[str, str]] = {}
    NEEDS: ClassVar[tuple[str, ...]] = ("vehicle_speed_mps", "time_s")
    ORDER: ClassVar[int] = 2
    SENTENCE: ClassVar[str] = "The contact takes a distance, not a time, to build up force."
    FORMULA: ClassVar[str] = (
        "(s/V) dmu/dt + mu = mu_steady, s the relaxation length in m, V the vehicle speed in m/s"
    )
    PHRASE: ClassVar[str] = "relaxation of the contact"
    FAMILY: ClassVar[str] = "in time"
    RESTS_ON: ClassVar[tuple[str, ...]] = ("vehicle_speed_mps", "time_s")
    SAME_AS: ClassVar[tuple[str, ...]] = ()
    SEEN_IN: ClassVar[tuple[str, ...]] = (
        "base_adhesion_change",
        "slip_size_change",
        "vehicle_speed_mps",
    )
    DRIVEN_BY: ClassVar[str] = "slip_ratio"

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
        speed = jnp.maximum(conditions["vehicle_speed_mps"], 0.1)
        memory = filtered(memory, adhesion, self.length / speed, now(conditions))
        return memory, memory.value

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [cls(length=length) for length in (0.3, 1.0, 3.0, 10.0)]

    @classmethod
    def planted(cls, runs: CleanRuns, phase: float, generator: np.random.Generator) -> Plan:
        return by_its_formula(lambda length: cls(length=length), 90.0, runs)

    @classmethod
    def planted_otherwise(cls, runs: CleanRuns, generator: np.random.Generator) -> Plan:
        """The length shrinks as the contact slides: s/(1 + |l|/.05)."""
        share = 1 / (1 + np.abs(runs.slip) / 0.05) / runs.speed
        return Plan(
            lambda a: planted(a, 2, after=lambda adhesion: runs.lagged(adhesion, a * share)), 90.0
        )
