from collections.abc import Mapping, Sequence
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect
from adhesion_jax.effects.cause import Scaling
from adhesion_jax.effects.planting import CleanRuns, Plan, by_factor, by_its_formula

_SOURCE = "Burckhardt 1993; He et al. 2018, Eq. 4"


class SlipSpeed(Scaling):
    """c4 is about .02 to .04 s/m. Source: Burckhardt 1993; He et al. 2018, Eq. 4."""

    c4: Scalar

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "c4": Parameter("s/m", -0.2, 2.0, "fall with slip velocity", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("c4",)
    REFERENCES: ClassVar[Mapping[str, str]] = {}
    NEEDS: ClassVar[tuple[str, ...]] = ("vehicle_speed_mps",)
    SENTENCE: ClassVar[str] = "Adhesion falls with slip velocity: Burckhardt's c4."
    FORMULA: ClassVar[str] = "mu exp(-c4 |l| V), l the slip ratio, V the vehicle speed in m/s"
    ONE_SIDED: ClassVar[bool] = True
    PHRASE: ClassVar[str] = "exponential loss with slip velocity"
    FAMILY: ClassVar[str] = "slip velocity"
    RESTS_ON: ClassVar[tuple[str, ...]] = ("slip_ratio", "vehicle_speed_mps")
    SAME_AS: ClassVar[tuple[str, ...]] = ("covariate:slip_velocity_mps",)
    SEEN_IN: ClassVar[tuple[str, ...]] = ("vehicle_speed_mps", "slip_velocity_mps")

    def factor(self, slip: Float[Array, "*shape"], conditions: Conditions) -> Float[Array, "..."]:
        return jnp.exp(-self.c4 * jnp.abs(slip) * conditions["vehicle_speed_mps"])

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [cls(c4=0.01)]

    @classmethod
    def planted(cls, runs: CleanRuns, phase: float, generator: np.random.Generator) -> Plan:
        return by_its_formula(lambda c4: cls(c4=c4), 1.5, runs)

    @classmethod
    def planted_otherwise(cls, runs: CleanRuns, generator: np.random.Generator) -> Plan:
        """1/(1 + a w)^2, w the slip velocity."""
        return by_factor(lambda a: 1 / (1 + a * runs.slip_velocity) ** 2, 5.0)
