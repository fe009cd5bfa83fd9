from collections.abc import Mapping, Sequence
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect
from adhesion_jax.effects.cause import Scaling
from adhesion_jax.effects.planting import CleanRuns, Plan, by_factor, by_its_formula

_SOURCE = "Curtius and Kniffler 1950, Elektrische Bahnen 21:25"


def _curtius_kniffler(speed: Float[Array, "*shape"] | Scalar) -> Float[Array, "*shape"]:
    return jnp.asarray(7.5 / (44 + 3.6 * speed) + 0.161)


class Speed(Scaling):
    """k = 1 is the law of Curtius and Kniffler itself. Source: Curtius and Kniffler 1950."""

    k: Scalar
    reference: Scalar

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "k": Parameter("1", -3.0, 5.0, "share of the law's fall with speed", _SOURCE),
        "reference": Parameter("m/s", 0.0, 200.0, "speed at which nothing changes", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("k",)
    REFERENCES: ClassVar[Mapping[str, str]] = {"reference": "vehicle_speed_mps"}
    NEEDS: ClassVar[tuple[str, ...]] = ("vehicle_speed_mps",)
    SENTENCE: ClassVar[str] = "Adhesion falls with the speed of travel."
    FORMULA: ClassVar[str] = (
        "mu (1 + k (f(V)/f(V0) - 1)), f(V) = 7.5/(44 + V) + 0.161, V the vehicle speed in km/h"
    )
    ONE_SIDED: ClassVar[bool] = True
    PHRASE: ClassVar[str] = "vehicle speed"
    FAMILY: ClassVar[str] = "slip velocity"
    RESTS_ON: ClassVar[tuple[str, ...]] = ("vehicle_speed_mps",)
    SAME_AS: ClassVar[tuple[str, ...]] = ("covariate:vehicle_speed_mps",)
    SEEN_IN: ClassVar[tuple[str, ...]] = ("vehicle_speed_mps", "slip_velocity_mps")

    def factor(self, slip: Float[Array, "*shape"], conditions: Conditions) -> Float[Array, "..."]:
        relative = _curtius_kniffler(conditions["vehicle_speed_mps"]) / _curtius_kniffler(
            self.reference
        )
        return 1 + self.k * (relative - 1)

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [cls(k=0.1, reference=float(np.median(columns["vehicle_speed_mps"])))]

    @classmethod
    def planted(cls, runs: CleanRuns, phase: float, generator: np.random.Generator) -> Plan:
        reference = runs.middle("vehicle_speed_mps")
        return by_its_formula(lambda k: cls(k=k, reference=reference), 3.0, runs)

    @classmethod
    def planted_otherwise(cls, runs: CleanRuns, generator: np.random.Generator) -> Plan:
        """1/(1 + a V/20)."""
        return by_factor(lambda a: 1 / (1 + a * runs.speed / 20), 5.0)
