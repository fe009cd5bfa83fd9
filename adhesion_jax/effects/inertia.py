from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect
from adhesion_jax.effects.cause import Changing, Remembering, now
from adhesion_jax.effects.history import has_history, rate
from adhesion_jax.effects.planting import CleanRuns, Plan, by_its_formula, planted

_SOURCE = "Voltr and Lata 2015, Veh. Syst. Dyn. 53:605-618"


class Inertia(Changing, Remembering):
    """k = J/(r^2 F), J the moment of inertia of what turns. Source: Newton; Voltr and Lata 2015."""

    k: Scalar

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "k": Parameter("s^2/m", -1.0, 1.0, "rotating mass over load", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("k",)
    REFERENCES: ClassVar[Mapping[str, str]] = {}
    NEEDS: ClassVar[tuple[str, ...]] = ("vehicle_speed_mps", "acceleration_mps2", "time_s")
    ORDER: ClassVar[int] = 2
    SENTENCE: ClassVar[str] = "The torque that accelerates the wheel was taken for adhesion."
    FORMULA: ClassVar[str] = (
        "mu + k d(V (1 + l))/dt, the circumferential acceleration of the wheel in m/s^2"
    )
    PHRASE: ClassVar[str] = "inertia of the wheel"
    FAMILY: ClassVar[str] = "in time"
    RESTS_ON: ClassVar[tuple[str, ...]] = ("vehicle_speed_mps", "acceleration_mps2", "time_s")
    SAME_AS: ClassVar[tuple[str, ...]] = ()
    SEEN_IN: ClassVar[tuple[str, ...]] = (
        "base_adhesion_change",
        "slip_size_change",
        "acceleration",
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
        # The speed is noisy, the slip is not: their rates are taken over different times.
        slipping = conditions["vehicle_speed_mps"] * rate(slip, conditions)
        rolling = conditions["acceleration_mps2"] * (1 + slip)
        return adhesion + self.k * (slipping + rolling)

    def init(
        self, adhesion: Float[Array, ""], slip: Float[Array, ""], conditions: Conditions
    ) -> Any:
        return now(conditions), slip

    def step(
        self,
        memory: Any,
        adhesion: Float[Array, ""],
        slip: Float[Array, ""],
        conditions: Conditions,
    ) -> tuple[Any, Float[Array, ""]]:
        time, before = memory
        passed = now(conditions) - time
        rate = (slip - before) / jnp.where(passed > 0, passed, jnp.inf)
        rolling = conditions["acceleration_mps2"] * (1 + slip)
        change = self.k * (conditions["vehicle_speed_mps"] * rate + rolling)
        return (now(conditions), slip), adhesion + change

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [cls(k=0.003)]

    @classmethod
    def planted(cls, runs: CleanRuns, phase: float, generator: np.random.Generator) -> Plan:
        return by_its_formula(lambda k: cls(k=k), 0.9, runs)

    @classmethod
    def planted_otherwise(cls, runs: CleanRuns, generator: np.random.Generator) -> Plan:
        """The acceleration has passed a filter of .15 s."""
        filtered = runs.lagged(runs.rate(runs.speed * (1 + runs.slip)), 0.15)
        return Plan(lambda a: planted(a, 2, after=lambda adhesion: adhesion + a * filtered), 0.9)
