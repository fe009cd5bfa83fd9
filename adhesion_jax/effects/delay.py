from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect
from adhesion_jax.effects.cause import Changing, Remembering, now
from adhesion_jax.effects.history import has_history, shifted
from adhesion_jax.effects.planting import CleanRuns, Plan, by_its_formula, planted

_SOURCE = "measuring chain"

#: Number of samples that the step form keeps: a longer delay is cut to these.
_KEPT = 1024


class Delay(Changing, Remembering):
    """A constant delay between two channels. Source: any measuring chain with separate channels."""

    delay: Scalar

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "delay": Parameter("s", -2.0, 5.0, "time by which adhesion is late", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("delay",)
    REFERENCES: ClassVar[Mapping[str, str]] = {}
    NEEDS: ClassVar[tuple[str, ...]] = ("time_s",)
    ORDER: ClassVar[int] = 2
    SENTENCE: ClassVar[str] = "The adhesion signal comes later than the slip signal."
    FORMULA: ClassVar[str] = "mu(t - d), d in s; negative where the slip signal is the late one"
    PHRASE: ClassVar[str] = "a delay between the signals"
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
        return shifted(adhesion, jnp.asarray(self.delay), conditions)

    def init(
        self, adhesion: Float[Array, ""], slip: Float[Array, ""], conditions: Conditions
    ) -> Any:
        times = jnp.full(_KEPT, now(conditions))
        return times - jnp.arange(_KEPT)[::-1], jnp.full(_KEPT, adhesion)

    def step(
        self,
        memory: Any,
        adhesion: Float[Array, ""],
        slip: Float[Array, ""],
        conditions: Conditions,
    ) -> tuple[Any, Float[Array, ""]]:
        times, values = memory
        # A second sample at the same time replaces the first.
        again = now(conditions) == times[-1]
        times = jnp.where(again, times, jnp.append(times[1:], now(conditions)))
        values = jnp.where(again, values.at[-1].set(adhesion), jnp.append(values[1:], adhesion))
        return (times, values), jnp.interp(now(conditions) - self.delay, times, values)

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [cls(delay=delay) for delay in (0.05, 0.15, 0.4, 1.0)]

    @classmethod
    def planted(cls, runs: CleanRuns, phase: float, generator: np.random.Generator) -> Plan:
        return by_its_formula(lambda delay: cls(delay=delay), 4.0, runs)

    @classmethod
    def planted_otherwise(cls, runs: CleanRuns, generator: np.random.Generator) -> Plan:
        """Not the same in every run: a tenth of spread."""
        clock = runs.columns["time_s"] - runs.columns["time_s"][:, :1]
        spread = 1 + 0.1 * generator.standard_normal((len(clock), 1))

        def late(adhesion: np.ndarray, amount: float) -> np.ndarray:
            each = zip(clock - amount * spread, clock, adhesion, strict=True)
            return np.stack([np.interp(*run) for run in each])

        return Plan(lambda a: planted(a, 2, after=lambda adhesion: late(adhesion, a)), 4.0)
