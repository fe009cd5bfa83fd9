import jax.numpy as jnp
import numpy as np

from adhesion_jax.effects.api import Cause, Columns, Conditions, Effect, Facts, Scalar, Signal

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
