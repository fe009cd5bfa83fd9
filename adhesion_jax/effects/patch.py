"""A place on the track where adhesion is low on every pass."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect

_SOURCE = "Fulford 2004, Review of low adhesion research, RSSB"


class Patch(Effect):
    """mu (1 - d exp(-|(x - x0)/w|^n)), x the position in m; n = 2 is smooth, a large n a box.

    Source: Fulford 2004, Review of low adhesion research, RSSB.
    """

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
        distance = jnp.abs(conditions["position_m"] - self.centre) / self.width
        bump = jnp.exp(-(jnp.maximum(distance, 1e-6) ** self.flatness))
        return adhesion * (1 - self.depth * bump)

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
