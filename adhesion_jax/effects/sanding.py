from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect
from adhesion_jax.effects.cause import Remembering, Scaling, now
from adhesion_jax.effects.history import has_history, recurrence, steps
from adhesion_jax.effects.planting import CleanRuns, Plan, by_factor, by_its_formula

_SOURCE = "Arias-Cuevas et al. 2010, Wear 268:543-551"


class Sanding(Scaling, Remembering):
    """Source: Arias-Cuevas et al. 2010, Wear 268, 543-551 (build-up about 1 s, decay 5 to 12 s)."""

    k: Scalar
    build_up: Scalar
    decay: Scalar

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "k": Parameter("1", -0.9, 3.0, "relative gain under sand", _SOURCE),
        "build_up": Parameter("s", 0.05, 10.0, "time constant of arrival", _SOURCE),
        "decay": Parameter("s", 0.05, 60.0, "time constant of loss", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("k",)
    REFERENCES: ClassVar[Mapping[str, str]] = {}
    NEEDS: ClassVar[tuple[str, ...]] = ("sanding", "time_s")
    SENTENCE: ClassVar[str] = "Sand raises adhesion; it takes time to arrive and stays for a while."
    FORMULA: ClassVar[str] = (
        "mu (1 + k s), s following the sanding flag: build-up over t1, decay over t2, in s"
    )
    ONE_SIDED: ClassVar[bool] = True
    PHRASE: ClassVar[str] = "sanding"
    FAMILY: ClassVar[str] = "sand"
    RESTS_ON: ClassVar[tuple[str, ...]] = ("sanding",)
    SAME_AS: ClassVar[tuple[str, ...]] = ("covariate:sanding",)
    SEEN_IN: ClassVar[tuple[str, ...]] = ("sanding", "sand_before")
    DRIVEN_BY: ClassVar[str] = "sanding"

    def factor(self, slip: Float[Array, "*shape"], conditions: Conditions) -> Float[Array, "..."]:
        flag = conditions["sanding"]
        if not has_history(conditions):
            return jnp.asarray(1 + self.k * flag)
        on = jnp.exp(-steps(conditions) / self.build_up)
        off = jnp.exp(-steps(conditions) / self.decay)
        kept = flag * on + (1 - flag) * off
        sand = recurrence(kept, (1 - kept) * flag)
        return 1 + self.k * sand

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
        time, sand = memory
        flag = conditions["sanding"]
        passed = now(conditions) - time
        kept = flag * jnp.exp(-passed / self.build_up) + (1 - flag) * jnp.exp(-passed / self.decay)
        sand = kept * sand + (1 - kept) * flag
        return (now(conditions), sand), adhesion * (1 + self.k * sand)

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [
            cls(k=0.05, build_up=up, decay=down) for up in (0.3, 1.0) for down in (0.3, 3.0, 8.0)
        ]

    @classmethod
    def planted(cls, runs: CleanRuns, phase: float, generator: np.random.Generator) -> Plan:
        decay = generator.uniform(3.0, 10.0)
        return by_its_formula(lambda k: cls(k=k, build_up=1.0, decay=decay), 2.5, runs)

    @classmethod
    def planted_otherwise(cls, runs: CleanRuns, generator: np.random.Generator) -> Plan:
        """1 + a s: sand arrives at once after .5 to 1 s and wears off linearly over 4 to 8 s."""
        dead = round(generator.uniform(0.5, 1.0) / runs.step)
        flag = np.pad(runs.columns["sanding"], ((0, 0), (dead, 0)))[:, : runs.slip.shape[1]]
        loss = runs.step / generator.uniform(4.0, 8.0)
        sand = flag.copy()
        for k in range(1, sand.shape[1]):
            sand[:, k] = np.maximum(flag[:, k], sand[:, k - 1] - loss)
        return by_factor(lambda a: 1 + a * sand, 2.5)
