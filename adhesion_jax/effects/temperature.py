"""Adhesion changes with the temperature."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect

_SOURCE = "Zhu et al. 2015, Tribol. Lett. 57:12; Milliken 1995"


class Temperature(Effect):
    """mu (1 + k (T - T0)), T in degrees Celsius.

    Source: Zhu, Olofsson and Chen 2015; Milliken 1995 for tyres.
    """

    k: Scalar
    reference: Scalar

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "k": Parameter("1/K", -0.1, 0.1, "relative change with temperature", _SOURCE),
        "reference": Parameter(
            "degree C", -80.0, 200.0, "temperature at which nothing changes", _SOURCE
        ),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("k",)
    REFERENCES: ClassVar[Mapping[str, str]] = {"reference": "temperature_C"}
    NEEDS: ClassVar[tuple[str, ...]] = ("temperature_C",)
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
        return adhesion * jnp.maximum(
            1 + self.k * (conditions["temperature_C"] - self.reference), 0.0
        )

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [cls(k=1e-3, reference=float(np.median(columns["temperature_C"])))]
