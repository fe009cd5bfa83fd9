from collections.abc import Mapping, Sequence
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect
from adhesion_jax.effects.cause import Scaling
from adhesion_jax.effects.planting import CleanRuns, Plan, by_factor, by_its_formula

_SOURCE = "Iwnicki 2006, Handbook of Railway Vehicle Dynamics"


class CurveOfTrack(Scaling):
    """Source: Iwnicki 2006, Handbook of Railway Vehicle Dynamics, chapter 4."""

    k: Scalar

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "k": Parameter("m", -300.0, 300.0, "relative loss per unit of curvature", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("k",)
    REFERENCES: ClassVar[Mapping[str, str]] = {}
    NEEDS: ClassVar[tuple[str, ...]] = ("curvature_per_m",)
    SENTENCE: ClassVar[str] = "Adhesion is lower in curves of the track."
    FORMULA: ClassVar[str] = "mu (1 - k |kappa|), kappa the curvature of the track in 1/m"
    ONE_SIDED: ClassVar[bool] = True
    PHRASE: ClassVar[str] = "curvature of the track"
    FAMILY: ClassVar[str] = "curvature"
    RESTS_ON: ClassVar[tuple[str, ...]] = ("curvature_per_m",)
    SAME_AS: ClassVar[tuple[str, ...]] = ("covariate:curvature_per_m",)
    SEEN_IN: ClassVar[tuple[str, ...]] = ("curvature_per_m", "position_m")

    def factor(self, slip: Float[Array, "*shape"], conditions: Conditions) -> Float[Array, "..."]:
        return jnp.maximum(1 - self.k * jnp.abs(conditions["curvature_per_m"]), 0.0)

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [cls(k=5.0)]

    @classmethod
    def planted(cls, runs: CleanRuns, phase: float, generator: np.random.Generator) -> Plan:
        return by_its_formula(lambda k: cls(k=k), 280.0, runs)

    @classmethod
    def planted_otherwise(cls, runs: CleanRuns, generator: np.random.Generator) -> Plan:
        """1 - a |kappa|/(|kappa| + 1/km)."""
        bent = np.abs(runs.columns["curvature_per_m"])
        return by_factor(lambda a: 1 - a * bent / (bent + 1e-3), 0.95)
