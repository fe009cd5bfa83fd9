"""The level of adhesion depends on the normal load."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect

_SOURCE = "Burckhardt 1993; Persson 2001, J. Chem. Phys. 115:3840"


class LoadPeak(Effect):
    """mu (F/F0)^-p, F the normal load in N, F0 its median in the data.

    Near F0 it is Burckhardt's 1 - c5 F^2 with p = 2 c5 F0^2/(1 - c5 F0^2); the power is how tyres
    and Hertzian contacts are described. Source: Burckhardt 1993; Persson 2001.
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
    ORDER: ClassVar[int] = 1

    def before(
        self, slip: Float[Array, "*shape"], conditions: Conditions
    ) -> Float[Array, "*shape"]:
        return slip

    def after(
        self,
        adhesion: Float[Array, "*shape"],
        slip: Float[Array, "*shape"],
        conditions: Conditions,
    ) -> Float[Array, "*shape"]:
        return adhesion * (conditions["normal_load_N"] / self.reference) ** (-self.p)

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [cls(p=0.05, reference=float(np.median(columns["normal_load_N"])))]
