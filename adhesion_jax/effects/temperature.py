from collections.abc import Mapping, Sequence
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect
from adhesion_jax.effects.cause import Scaling
from adhesion_jax.effects.planting import CleanRuns, Plan, by_factor, by_its_formula

_SOURCE = "Zhu et al. 2015, Tribol. Lett. 57:12; Milliken 1995"


class Temperature(Scaling):
    """Source: Zhu, Olofsson and Chen 2015; Milliken 1995 for tyres."""

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
    SENTENCE: ClassVar[str] = "Adhesion changes with the temperature."
    FORMULA: ClassVar[str] = "mu (1 + k (T - T0)), T in degrees Celsius"
    PHRASE: ClassVar[str] = "temperature"
    FAMILY: ClassVar[str] = "temperature"
    RESTS_ON: ClassVar[tuple[str, ...]] = ("temperature_C",)
    SAME_AS: ClassVar[tuple[str, ...]] = ("covariate:temperature_C",)
    SEEN_IN: ClassVar[tuple[str, ...]] = ("temperature_C",)

    def factor(self, slip: Float[Array, "*shape"], conditions: Conditions) -> Float[Array, "..."]:
        return jnp.maximum(1 + self.k * (conditions["temperature_C"] - self.reference), 0.0)

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [cls(k=1e-3, reference=float(np.median(columns["temperature_C"])))]

    @classmethod
    def planted(cls, runs: CleanRuns, phase: float, generator: np.random.Generator) -> Plan:
        reference = runs.middle("temperature_C")
        return by_its_formula(lambda k: cls(k=k, reference=reference), 0.09, runs)

    @classmethod
    def planted_otherwise(cls, runs: CleanRuns, generator: np.random.Generator) -> Plan:
        """1 + a u^2, u the temperature over its range, from 0 to 1."""
        celsius = runs.columns["temperature_C"]
        warm = (celsius - celsius.min()) / np.ptp(celsius)
        return by_factor(lambda a: 1 + a * warm**2, 2.0)
