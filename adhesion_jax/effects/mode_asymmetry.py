from collections.abc import Mapping, Sequence
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect
from adhesion_jax.effects.cause import Scaling
from adhesion_jax.effects.planting import CleanRuns, Plan, by_factor, by_its_formula

_SOURCE = "Arias-Cuevas and Li 2011, Wear 271:1482-1491"


class ModeAsymmetry(Scaling):
    """Source: Arias-Cuevas and Li 2011, Wear 271, 1482-1491."""

    k: Scalar

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "k": Parameter("1", -0.9, 0.9, "half the relative difference", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("k",)
    REFERENCES: ClassVar[Mapping[str, str]] = {}
    NEEDS: ClassVar[tuple[str, ...]] = ("mode",)
    SENTENCE: ClassVar[str] = "Adhesion differs between traction and braking."
    FORMULA: ClassVar[str] = "mu (1 + k m), m = 1 in traction, -1 in braking, 0 in coasting"
    PHRASE: ClassVar[str] = "a difference between traction and braking"
    FAMILY: ClassVar[str] = "mode_asymmetry"
    RESTS_ON: ClassVar[tuple[str, ...]] = ("mode",)
    SAME_AS: ClassVar[tuple[str, ...]] = ("covariate:mode",)
    SEEN_IN: ClassVar[tuple[str, ...]] = ("mode",)

    def factor(self, slip: Float[Array, "*shape"], conditions: Conditions) -> Float[Array, "..."]:
        return jnp.asarray(1 + self.k * conditions["mode"])

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [cls(k=0.03)]

    @classmethod
    def planted(cls, runs: CleanRuns, phase: float, generator: np.random.Generator) -> Plan:
        return by_its_formula(lambda k: cls(k=k), 0.9, runs)

    @classmethod
    def planted_otherwise(cls, runs: CleanRuns, generator: np.random.Generator) -> Plan:
        """1 - a |l|/(|l| + .01) in braking."""
        braking = (runs.slip < 0) * np.abs(runs.slip) / (np.abs(runs.slip) + 0.01)
        return by_factor(lambda a: 1 - a * braking, 0.95)
