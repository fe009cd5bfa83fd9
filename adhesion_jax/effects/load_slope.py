from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect
from adhesion_jax.effects.cause import Bending
from adhesion_jax.effects.planting import CleanRuns, Plan, by_its_formula, planted

_SOURCE = "Kalker 1967, thesis, Delft"


class LoadSlope(Bending):
    """The stiffness of a Hertzian contact over its load goes as F^(-1/3).

    Source: Kalker 1967; Hertz.
    """

    p: Scalar
    reference: Scalar

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "p": Parameter("1", -3.0, 3.0, "power of the load", _SOURCE),
        "reference": Parameter("N", 0.001, 1000000.0, "load at which nothing changes", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("p",)
    REFERENCES: ClassVar[Mapping[str, str]] = {"reference": "normal_load_N"}
    NEEDS: ClassVar[tuple[str, ...]] = ("normal_load_N",)
    SENTENCE: ClassVar[str] = "The steepness of the rise depends on the normal load."
    FORMULA: ClassVar[str] = (
        "mu(l (F/F0)^-p): adhesion rises less steeply under load, its level stays"
    )
    PHRASE: ClassVar[str] = "normal load on the slope"
    FAMILY: ClassVar[str] = "load"
    RESTS_ON: ClassVar[tuple[str, ...]] = ("normal_load_N",)
    SAME_AS: ClassVar[tuple[str, ...]] = ("covariate:normal_load_N",)
    SEEN_IN: ClassVar[tuple[str, ...]] = ("normal_load_N",)

    def before(
        self, slip: Float[Array, "*shape"], conditions: Conditions
    ) -> Float[Array, "*shape"]:
        return slip * (conditions["normal_load_N"] / self.reference) ** (-self.p)

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [cls(p=0.05, reference=float(np.median(columns["normal_load_N"])))]

    @classmethod
    def planted(cls, runs: CleanRuns, phase: float, generator: np.random.Generator) -> Plan:
        reference = runs.middle("normal_load_N")
        return by_its_formula(lambda p: cls(p=p, reference=reference), 2.8, runs)

    @classmethod
    def planted_otherwise(cls, runs: CleanRuns, generator: np.random.Generator) -> Plan:
        """l/(1 + a (F/F0)^2)."""
        square = (runs.columns["normal_load_N"] / runs.middle("normal_load_N")) ** 2
        return Plan(lambda a: planted(a, 0, before=lambda slip: slip / (1 + a * square)), 5.0)
