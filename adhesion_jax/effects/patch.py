import jax.numpy as jnp
import numpy as np

from adhesion_jax.effects.api import Columns, Conditions, Effect, Facts, Multiplier, Scalar, Values


class Patch(Multiplier):
    depth: Scalar
    centre: Scalar
    width: Scalar
    flatness: Scalar

    FACTS = Facts(
        source="Fulford 2004, Review of low adhesion research, RSSB",
        described={
            "depth": ("1", -3.0, 1.0, "share of adhesion lost in the middle"),
            "centre": ("m", -1e7, 1e7, "position of the middle"),
            "width": ("m", 1.0, 10000.0, "half width"),
            "flatness": ("1", 1.0, 12.0, "power of the distance"),
        },
        strengths=("depth",),
        starts=(),
        needs=("position_m",),
        sentence="A place on the track where adhesion is low on every pass.",
        formula="mu (1 - d exp(-|(x - x0)/w|^n)), x the position in m; n = 2 is smooth, a large "
        "n a box",
        phrase="a patch on the rail",
        family="place",
        one_sided=True,
        same_as=("covariate:position_m",),
    )

    def factor(self, slip: Values, conditions: Conditions) -> Values:
        distance = jnp.abs(conditions["position_m"] - self.centre) / self.width
        bump = jnp.exp(-(jnp.maximum(distance, 1e-6) ** self.flatness))
        return 1 - self.depth * bump

    @classmethod
    def starts(cls, columns: Columns) -> list[Effect]:
        low, high = (float(end) for end in np.quantile(columns["position_m"], [0.0, 1.0]))
        if high <= low:
            return []
        widths = (high - low) / np.array([60, 25, 10])
        return [
            cls(depth=0.05, centre=float(centre), width=float(width), flatness=2.0)
            for width in widths
            for centre in np.arange(low, high, 1.5 * width)
        ]
