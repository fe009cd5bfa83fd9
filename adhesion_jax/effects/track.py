"""What a place of the track does: a curve, lateral creep in it, a patch."""

import jax.numpy as jnp
import numpy as np

from adhesion_jax.effects.api import (
    Cause,
    Columns,
    Conditions,
    Effect,
    Facts,
    Multiplier,
    Scalar,
    Signal,
    Values,
)


class CurveOfTrack(Multiplier):
    k: Scalar

    FACTS = Facts(
        source="Iwnicki 2006, Handbook of Railway Vehicle Dynamics, chapter 4",
        described={"k": ("m", -300.0, 300.0, "relative loss per unit of curvature")},
        strengths=("k",),
        starts=({"k": 5.0},),
        needs=("curvature_per_m",),
        sentence="Adhesion is lower in curves of the track.",
        formula="mu (1 - k |kappa|), kappa the curvature of the track in 1/m",
        phrase="curvature of the track",
        family="curvature",
        one_sided=True,
        same_as=("covariate:curvature_per_m",),
    )

    def factor(self, slip: Values, conditions: Conditions) -> Values:
        return jnp.maximum(1 - self.k * jnp.abs(conditions["curvature_per_m"]), 0.0)


#: Keeps the square root differentiable where there is neither slip nor lateral creepage.
_SMALL = 1e-16


class LateralCreep(Cause):
    """The column y is the lateral creepage where it is measured (g near one), else the curvature.

    An axle meets a curve at an angle of about its distance from the middle times the curvature,
    so that g is then in m.
    """

    gain: Scalar
    offset: Scalar

    FACTS = Facts(
        source="Polach 2005, Wear 258, 992-1000; Kalker 1967",
        described={
            "gain": ("1 or m", 0.0, 50.0, "lateral creepage per unit of the column"),
            "offset": ("1 or 1/m", -0.2, 0.2, "column value without lateral creepage"),
        },
        strengths=("gain",),
        starts=(),
        needs=("lateral_measure",),
        sentence="Lateral creep uses a part of the friction.",
        formula="mu(l_t) l/l_t, l_t^2 = l^2 + l_y^2, l_y = g (y - y0)",
        phrase="lateral creep",
        family="curvature",
        same_as=("covariate:angle_of_attack_deg", "covariate:lateral_creepage"),
    )
    ORDER = 0

    def _total(self, slip: Signal, conditions: Conditions) -> Signal:
        lateral = self.gain * (conditions["lateral_measure"] - self.offset)
        return jnp.sqrt(slip**2 + lateral**2 + _SMALL)

    def before(self, slip: Signal, conditions: Conditions) -> Signal:
        return jnp.where(slip < 0, -1.0, 1.0) * self._total(slip, conditions)

    def after(self, adhesion: Signal, slip: Signal, conditions: Conditions) -> Signal:
        return adhesion * jnp.abs(slip) / self._total(slip, conditions)

    @classmethod
    def starts(cls, columns: Columns) -> list[Effect]:
        spread = float(np.std(columns["lateral_measure"]))
        return [
            cls(gain=min(gain, 50.0), offset=0.0) for gain in (0.3, 1.0, 0.005 / max(spread, 1e-6))
        ]


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
