from collections.abc import Mapping, Sequence
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect
from adhesion_jax.effects.cause import Scaling
from adhesion_jax.effects.planting import CleanRuns, Plan, by_factor, by_its_formula

_SOURCE = "Beagley and Pritchard 1975, Wear 35:299; Zhu et al. 2015, Tribol. Lett. 57:12"


class Humidity(Scaling):
    """A wide w is linear, a centre c at an end saturates, a narrow w is a threshold.

    Source: Beagley and Pritchard 1975; Zhu, Olofsson and Chen 2015.
    """

    k: Scalar
    centre: Scalar
    width: Scalar
    reference: Scalar

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "k": Parameter("1", -0.9, 0.9, "half the change over the range", _SOURCE),
        "centre": Parameter("%", -20.0, 120.0, "humidity of the steepest change", _SOURCE),
        "width": Parameter("%", 4.0, 200.0, "range of the change", _SOURCE),
        "reference": Parameter("%", 0.0, 100.0, "humidity at which nothing changes", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("k",)
    REFERENCES: ClassVar[Mapping[str, str]] = {"reference": "relative_humidity_pct"}
    NEEDS: ClassVar[tuple[str, ...]] = ("relative_humidity_pct",)
    SENTENCE: ClassVar[str] = (
        "Humidity of the air changes adhesion: linearly, with saturation, or beyond a threshold."
    )
    FORMULA: ClassVar[str] = (
        "mu (1 + k (s(H) - s(H0))), s(H) = tanh((H - c)/w)/tanh(50/w), H the relative humidity in %"
    )
    PHRASE: ClassVar[str] = "humidity"
    FAMILY: ClassVar[str] = "humidity"
    RESTS_ON: ClassVar[tuple[str, ...]] = ("relative_humidity_pct",)
    SAME_AS: ClassVar[tuple[str, ...]] = ("covariate:relative_humidity_pct",)
    SEEN_IN: ClassVar[tuple[str, ...]] = ("relative_humidity_pct",)

    def factor(self, slip: Float[Array, "*shape"], conditions: Conditions) -> Float[Array, "..."]:
        def share(humidity: Float[Array, "*shape"] | Scalar) -> Float[Array, "*shape"]:
            return jnp.tanh((humidity - self.centre) / self.width) / jnp.tanh(50 / self.width)

        change = share(conditions["relative_humidity_pct"]) - share(self.reference)
        return jnp.maximum(1 + self.k * change, 0.0)

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        reference = float(np.median(columns["relative_humidity_pct"]))
        low, high = np.quantile(columns["relative_humidity_pct"], [0.05, 0.95])
        grid = [(reference, 150.0), *((c, 15.0) for c in np.linspace(low, high, 5))]
        return [cls(k=0.03, centre=float(c), width=w, reference=reference) for c, w in grid]

    @classmethod
    def planted(cls, runs: CleanRuns, phase: float, generator: np.random.Generator) -> Plan:
        kinds = ((62.0, 150.0), (35.0, 25.0), (72.0, 8.0))
        centre, width = kinds[generator.integers(len(kinds))]
        reference = runs.middle("relative_humidity_pct")
        return by_its_formula(
            lambda a: cls(k=-a, centre=centre, width=width, reference=reference), 0.9, runs
        )

    @classmethod
    def planted_otherwise(cls, runs: CleanRuns, generator: np.random.Generator) -> Plan:
        """1 - a/(1 + exp(-(H - c)/w)), c and w drawn."""
        centre, width = generator.uniform(50.0, 75.0), generator.uniform(5.0, 10.0)
        wet = 1 / (1 + np.exp(-(runs.columns["relative_humidity_pct"] - centre) / width))
        return by_factor(lambda a: 1 - a * wet, 0.95)
