import jax.numpy as jnp

from adhesion_jax.effects.api import Conditions, Facts, Multiplier, Scalar, Values


class ModeAsymmetry(Multiplier):
    k: Scalar

    FACTS = Facts(
        source="Arias-Cuevas and Li 2011, Wear 271:1482-1491",
        described={"k": ("1", -0.9, 0.9, "half the relative difference")},
        strengths=("k",),
        starts=({"k": 0.03},),
        needs=("mode",),
        sentence="Adhesion differs between traction and braking.",
        formula="mu (1 + k m), m = 1 in traction, -1 in braking, 0 in coasting",
        phrase="a difference between traction and braking",
        family="mode_asymmetry",
        same_as=("covariate:mode",),
    )

    def factor(self, slip: Values, conditions: Conditions) -> Values:
        return jnp.asarray(1 + self.k * conditions["mode"])
