from collections.abc import Mapping, Sequence
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect
from adhesion_jax.effects.cause import Scaling
from adhesion_jax.effects.planting import CleanRuns, Plan, by_factor, by_its_formula

_SOURCE = "Fulford 2004, Review of low adhesion research, RSSB"


class Patch(Scaling):
    """Source: Fulford 2004, Review of low adhesion research, RSSB."""

    depth: Scalar
    centre: Scalar
    width: Scalar
    flatness: Scalar

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "depth": Parameter("1", -3.0, 1.0, "share of adhesion lost in the middle", _SOURCE),
        "centre": Parameter("m", -10000000.0, 10000000.0, "position of the middle", _SOURCE),
        "width": Parameter("m", 1.0, 10000.0, "half width", _SOURCE),
        "flatness": Parameter("1", 1.0, 12.0, "power of the distance", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("depth",)
    REFERENCES: ClassVar[Mapping[str, str]] = {}
    NEEDS: ClassVar[tuple[str, ...]] = ("position_m",)
    SENTENCE: ClassVar[str] = "A place on the track where adhesion is low on every pass."
    FORMULA: ClassVar[str] = (
        "mu (1 - d exp(-|(x - x0)/w|^n)), x the position in m; n = 2 is smooth, a large n a box"
    )
    ONE_SIDED: ClassVar[bool] = True
    PHRASE: ClassVar[str] = "a patch on the rail"
    FAMILY: ClassVar[str] = "place"
    RESTS_ON: ClassVar[tuple[str, ...]] = ("position_m",)
    SAME_AS: ClassVar[tuple[str, ...]] = ("covariate:position_m",)
    SEEN_IN: ClassVar[tuple[str, ...]] = ("position_m",)

    def factor(self, slip: Float[Array, "*shape"], conditions: Conditions) -> Float[Array, "..."]:
        distance = jnp.abs(conditions["position_m"] - self.centre) / self.width
        bump = jnp.exp(-(jnp.maximum(distance, 1e-6) ** self.flatness))
        return 1 - self.depth * bump

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        low, high = (float(end) for end in np.quantile(columns["position_m"], [0.0, 1.0]))
        if high <= low:
            return []
        widths = (high - low) / np.array([60, 25, 10])
        return [
            cls(depth=0.05, centre=float(centre), width=float(width), flatness=2.0)
            for width in widths
            for centre in np.arange(low, high, 1.5 * width)
        ]

    @classmethod
    def planted(cls, runs: CleanRuns, phase: float, generator: np.random.Generator) -> Plan:
        centre = float(np.quantile(runs.columns["position_m"], generator.uniform(0.3, 0.7)))
        width = generator.uniform(50.0, 110.0)
        return by_its_formula(
            lambda depth: cls(depth=depth, centre=centre, width=width, flatness=2.0), 0.9, runs
        )

    @classmethod
    def planted_otherwise(cls, runs: CleanRuns, generator: np.random.Generator) -> Plan:
        """1 - a (1 + cos(pi u))/2, u the distance from the middle over a reach of 70 to 150 m."""
        position = runs.columns["position_m"]
        centre = float(np.quantile(position, generator.uniform(0.3, 0.7)))
        place = np.clip((position - centre) / generator.uniform(70.0, 150.0), -1, 1)
        bump = 0.5 * (1 + np.cos(np.pi * place))
        return by_factor(lambda a: 1 - a * bump, 0.95)
