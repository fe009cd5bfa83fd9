"""Something changes over the campaign: slowly, in a step, or dying away."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect

_SOURCE = "calibration"


class Drift(Effect):
    """mu (1 + k (s(t) - s(t0))), s(t) = tanh((t - c)/w), t from 0 to 1 over the campaign.

    A wide w is linear, a narrow one a step, a centre at the start an exponential approach.
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
        def share(time: Float[Array, "*shape"] | Scalar) -> Float[Array, "*shape"]:
            return jnp.tanh((time - self.centre) / self.width) / jnp.tanh(1 / self.width)

        change = share(conditions["campaign_time"]) - share(self.reference)
        return adhesion * jnp.maximum(1 + self.k * change, 0.0)

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        grid = [(0.5, 3.0), (0.0, 0.3), *((float(c), 0.03) for c in np.linspace(0.15, 0.85, 8))]
        return [cls(k=0.03, centre=c, width=w, reference=0.5) for c, w in grid]
