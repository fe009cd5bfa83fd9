"""The steepness of the rise depends on the normal load."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect

_SOURCE = "Kalker 1967, thesis, Delft"


class LoadSlope(Effect):
    """mu(l (F/F0)^-p): adhesion rises less steeply under load, its level stays.

    The stiffness of a Hertzian contact over its load goes as F^(-1/3). Source: Kalker 1967; Hertz.
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
    ORDER: ClassVar[int] = 0

    def before(
        self, slip: Float[Array, "*shape"], conditions: Conditions
    ) -> Float[Array, "*shape"]:
        return slip * (conditions["normal_load_N"] / self.reference) ** (-self.p)

    def after(
        self,
        adhesion: Float[Array, "*shape"],
        slip: Float[Array, "*shape"],
        conditions: Conditions,
    ) -> Float[Array, "*shape"]:
        return adhesion

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [cls(p=0.05, reference=float(np.median(columns["normal_load_N"])))]
