from collections.abc import Mapping, Sequence
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect
from adhesion_jax.effects.cause import Scaling
from adhesion_jax.effects.planting import CleanRuns, Plan, by_factor, by_its_formula

_SOURCE = "Polach 2005, Wear 258, 992-1000"


class FallingFriction(Scaling):
    """Source: Polach 2005, Wear 258, 992-1000 (dry A = .4, b = .6 s/m; wet A = .4, b = .2 s/m)."""

    drop: Scalar
    b: Scalar

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "drop": Parameter("1", -0.5, 1.0, "share of friction lost at high slip velocity", _SOURCE),
        "b": Parameter("s/m", 0.02, 20.0, "decay of friction with slip velocity", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("drop",)
    REFERENCES: ClassVar[Mapping[str, str]] = {}
    NEEDS: ClassVar[tuple[str, ...]] = ("vehicle_speed_mps",)
    SENTENCE: ClassVar[str] = "Friction falls with slip velocity: Polach's law on any curve."
    FORMULA: ClassVar[str] = (
        "mu (1 - d (1 - exp(-b w))), w = |l| V the slip velocity in m/s; d = 1 - A of the source"
    )
    ONE_SIDED: ClassVar[bool] = True
    PHRASE: ClassVar[str] = "falling friction"
    FAMILY: ClassVar[str] = "slip velocity"
    RESTS_ON: ClassVar[tuple[str, ...]] = ("slip_ratio", "vehicle_speed_mps")
    SAME_AS: ClassVar[tuple[str, ...]] = ("covariate:slip_velocity_mps",)
    SEEN_IN: ClassVar[tuple[str, ...]] = ("vehicle_speed_mps", "slip_velocity_mps")

    def factor(self, slip: Float[Array, "*shape"], conditions: Conditions) -> Float[Array, "..."]:
        slip_velocity = jnp.abs(slip) * conditions["vehicle_speed_mps"]
        return 1 + self.drop * jnp.expm1(-self.b * slip_velocity)

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [cls(drop=0.05, b=b) for b in (0.1, 0.3, 0.8, 2.0, 6.0)]

    @classmethod
    def planted(cls, runs: CleanRuns, phase: float, generator: np.random.Generator) -> Plan:
        b = generator.uniform(0.3, 1.5)
        return by_its_formula(lambda drop: cls(drop=drop, b=b), 0.9, runs)

    @classmethod
    def planted_otherwise(cls, runs: CleanRuns, generator: np.random.Generator) -> Plan:
        """1 - a + a/(1 + w/.6), w the slip velocity."""
        return by_factor(lambda a: 1 - a + a / (1 + runs.slip_velocity / 0.6), 0.95)
