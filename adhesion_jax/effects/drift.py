from collections.abc import Mapping, Sequence
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect
from adhesion_jax.effects.cause import Scaling
from adhesion_jax.effects.planting import CleanRuns, Plan, by_factor, by_its_formula

_SOURCE = "calibration"


class Drift(Scaling):
    """A wide w is linear, a narrow one a step, a centre at the start an exponential approach.

    Source: any calibration.
    """

    k: Scalar
    centre: Scalar
    width: Scalar
    reference: Scalar

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "k": Parameter("1", -0.9, 0.9, "half the change", _SOURCE),
        "centre": Parameter("1", -0.5, 1.5, "time of the steepest change", _SOURCE),
        "width": Parameter("1", 0.01, 4.0, "duration of the change", _SOURCE),
        "reference": Parameter("1", 0.0, 1.0, "time at which nothing changes", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("k",)
    REFERENCES: ClassVar[Mapping[str, str]] = {"reference": "campaign_time"}
    NEEDS: ClassVar[tuple[str, ...]] = ("campaign_time",)
    SENTENCE: ClassVar[str] = (
        "Adhesion changes over the campaign: slowly, in a step, or levelling off."
    )
    FORMULA: ClassVar[str] = (
        "mu (1 + k (s(t) - s(t0))), s(t) = tanh((t - c)/w), t from 0 to 1 over the campaign"
    )
    PHRASE: ClassVar[str] = "a drift over the campaign"
    FAMILY: ClassVar[str] = "calendar"
    RESTS_ON: ClassVar[tuple[str, ...]] = ("campaign_time",)
    SAME_AS: ClassVar[tuple[str, ...]] = ("covariate:time_s", "covariate:campaign_time")
    SEEN_IN: ClassVar[tuple[str, ...]] = ("rail_age_days", "time_s")

    def factor(self, slip: Float[Array, "*shape"], conditions: Conditions) -> Float[Array, "..."]:
        def share(time: Float[Array, "*shape"] | Scalar) -> Float[Array, "*shape"]:
            return jnp.tanh((time - self.centre) / self.width) / jnp.tanh(1 / self.width)

        change = share(conditions["campaign_time"]) - share(self.reference)
        return jnp.maximum(1 + self.k * change, 0.0)

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        grid = [(0.5, 3.0), (0.0, 0.3), *((float(c), 0.03) for c in np.linspace(0.15, 0.85, 8))]
        return [cls(k=0.03, centre=c, width=w, reference=0.5) for c, w in grid]

    @classmethod
    def planted(cls, runs: CleanRuns, phase: float, generator: np.random.Generator) -> Plan:
        kinds = ((0.5, 3.0), (generator.uniform(0.3, 0.7), 0.03))
        centre, width = kinds[generator.integers(len(kinds))]
        return by_its_formula(
            lambda k: cls(k=k, centre=centre, width=width, reference=0.5), 0.9, runs
        )

    @classmethod
    def planted_otherwise(cls, runs: CleanRuns, generator: np.random.Generator) -> Plan:
        """1 - a (1 - exp(-t/T)), T .3 of the whole time."""
        time = runs.columns["time_s"]
        worn = -np.expm1(-(time - time.min()) / (0.3 * np.ptp(time)))
        return by_factor(lambda a: 1 - a * worn, 0.95)
