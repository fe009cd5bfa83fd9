from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect
from adhesion_jax.effects.cause import Changing, Remembering, now
from adhesion_jax.effects.history import has_history, steps
from adhesion_jax.effects.planting import CleanRuns, Plan, by_factor, by_its_formula

#: F0 of the formula: the load in N at which the slip energy is counted with the factor 1.
_LOAD = 1e5

_SOURCE = "Voltr and Lata 2015, Veh. Syst. Dyn. 53:605-618"


class Cleaning(Changing, Remembering):
    """The work W is in m; with q = 1 it is the slip energy over 100 kN, with q = 0 over the load.

    Source: Voltr and Lata 2015, Veh. Syst. Dyn. 53:605-618 (there a dirty and a recovered curve
    are mixed by the same weight).
    """

    k: Scalar
    work: Scalar
    load_power: Scalar

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "k": Parameter("1", -0.9, 5.0, "relative gain once clean", _SOURCE),
        "work": Parameter("m", 0.001, 1000.0, "slip work that cleans to 63 %", _SOURCE),
        "load_power": Parameter("1", 0.0, 1.0, "power of the load in the work", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("k",)
    REFERENCES: ClassVar[Mapping[str, str]] = {}
    NEEDS: ClassVar[tuple[str, ...]] = ("vehicle_speed_mps", "time_s")
    ORDER: ClassVar[int] = 1
    SENTENCE: ClassVar[str] = (
        "Slipping wheels clean the rail: adhesion recovers with the work done in the contact."
    )
    FORMULA: ClassVar[str] = (
        "mu (1 + k (1 - exp(-W/W0))), W the integral of |mu| |l| V (F/F0)^q dt since the run began"
    )
    ONE_SIDED: ClassVar[bool] = True
    PHRASE: ClassVar[str] = "cleaning by slip"
    FAMILY: ClassVar[str] = "cleaning"
    RESTS_ON: ClassVar[tuple[str, ...]] = ("slip_ratio", "vehicle_speed_mps", "time_s")
    SAME_AS: ClassVar[tuple[str, ...]] = ()
    SEEN_IN: ClassVar[tuple[str, ...]] = (
        "work",
        "time_s",
        "time_in_run",
        "vehicle_speed_mps",
        "slip_velocity_mps",
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
        work = jnp.cumsum(self._power(adhesion, slip, conditions) * steps(conditions))
        return adhesion * (1 - self.k * jnp.expm1(-work / self.work))

    def _power(
        self,
        adhesion: Float[Array, "*shape"],
        slip: Float[Array, "*shape"],
        conditions: Conditions,
    ) -> Float[Array, "*shape"]:
        """Slip power over the load, m/s."""
        slip_velocity = jnp.abs(slip) * conditions["vehicle_speed_mps"]
        load = jnp.asarray(conditions.get("normal_load_N", _LOAD)) / _LOAD
        return jnp.abs(adhesion) * slip_velocity * load**self.load_power

    def init(
        self, adhesion: Float[Array, ""], slip: Float[Array, ""], conditions: Conditions
    ) -> Any:
        return now(conditions), jnp.zeros(())

    def step(
        self,
        memory: Any,
        adhesion: Float[Array, ""],
        slip: Float[Array, ""],
        conditions: Conditions,
    ) -> tuple[Any, Float[Array, ""]]:
        time, work = memory
        work = work + self._power(adhesion, slip, conditions) * (now(conditions) - time)
        return (now(conditions), work), adhesion * (1 - self.k * jnp.expm1(-work / self.work))

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [cls(k=0.05, work=work, load_power=0.5) for work in (0.1, 0.3, 1.0, 3.0, 10.0)]

    @classmethod
    def planted(cls, runs: CleanRuns, phase: float, generator: np.random.Generator) -> Plan:
        work = generator.uniform(0.3, 1.0)
        return by_its_formula(lambda k: cls(k=k, work=work, load_power=1.0), 4.0, runs)

    @classmethod
    def planted_otherwise(cls, runs: CleanRuns, generator: np.random.Generator) -> Plan:
        """(1 - s) dirty + s clean, s = 1 - exp(-W/W0): two curves, as in Voltr and Lata 2015."""
        power = np.abs(runs.curve(runs.slip)) * runs.slip_velocity
        clean = -np.expm1(-np.cumsum(power * runs.step, axis=1) / generator.uniform(0.3, 1.0))
        flatter = runs.curve(0.6 * runs.slip) / runs.curve(runs.slip)
        return by_factor(lambda a: (1 - clean) * ((1 - a) * flatter**a) + clean, 0.95)
