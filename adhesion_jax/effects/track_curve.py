import jax.numpy as jnp

from adhesion_jax.effects.api import Conditions, Facts, Multiplier, Scalar, Values


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
