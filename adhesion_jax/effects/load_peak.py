from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect
from adhesion_jax.effects.cause import Scaling
from adhesion_jax.effects.planting import CleanRuns, Plan, by_factor, by_its_formula

_SOURCE = "Burckhardt 1993; Persson 2001, J. Chem. Phys. 115:3840"


class LoadPeak(Scaling):
    """Near F0 it is Burckhardt's 1 - c5 F^2 with p = 2 c5 F0^2/(1 - c5 F0^2).

    The power is how tyres and Hertzian contacts are described.
    Source: Burckhardt 1993; Persson 2001.
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
    SENTENCE: ClassVar[str] = "The level of adhesion depends on the normal load."
    FORMULA: ClassVar[str] = "mu (F/F0)^-p, F the normal load in N, F0 its median in the data"
    PHRASE: ClassVar[str] = "normal load on the peak"
    FAMILY: ClassVar[str] = "load"
    RESTS_ON: ClassVar[tuple[str, ...]] = ("normal_load_N",)
    SAME_AS: ClassVar[tuple[str, ...]] = ("covariate:normal_load_N",)
    SEEN_IN: ClassVar[tuple[str, ...]] = ("normal_load_N",)

    def factor(self, slip: Float[Array, "*shape"], conditions: Conditions) -> Float[Array, "..."]:
        return (conditions["normal_load_N"] / self.reference) ** (-self.p)

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [cls(p=0.05, reference=float(np.median(columns["normal_load_N"])))]

    @classmethod
    def planted(cls, runs: CleanRuns, phase: float, generator: np.random.Generator) -> Plan:
        reference = runs.middle("normal_load_N")
        return by_its_formula(lambda p: cls(p=p, reference=reference), 2.8, runs)

    @classmethod
    def planted_otherwise(cls, runs: CleanRuns, generator: np.random.Generator) -> Plan:
        """1 - a (F/150 kN)^2."""
        square = (runs.columns["normal_load_N"] / 150e3) ** 2
        return by_factor(lambda a: 1 - a * square, 0.95)
