"""Differences between axles, and between traction and braking."""

import jax.numpy as jnp

from adhesion_jax.effects.api import Conditions, Facts, Multiplier, Scalar, Values


class AxlePosition(Multiplier):
    """Up to six axles; those beyond share the last."""

    k1: Scalar
    k2: Scalar
    k3: Scalar
    k4: Scalar
    k5: Scalar

    FACTS = Facts(
        source="Voltr and Lata 2015, Veh. Syst. Dyn. 53:605-618",
        described={f"k{j}": ("1", -0.9, 3.0, f"relative change at axle {j}") for j in range(1, 6)},
        strengths=("k1", "k2", "k3", "k4", "k5"),
        starts=({f"k{j}": 0.03 for j in range(1, 6)},),
        needs=("axle",),
        sentence="Leading axles run on a dirtier rail than those behind.",
        formula="mu (1 + k_j) at axle j; axle 0, the first label of the data, is the reference",
        phrase="position of the axle",
        family="axle",
        same_as=("covariate:axle",),
        rising=True,
    )

    def factor(self, slip: Values, conditions: Conditions) -> Values:
        strengths = jnp.stack([jnp.zeros(()), self.k1, self.k2, self.k3, self.k4, self.k5])
        axle = jnp.clip(jnp.asarray(conditions["axle"]), 0, 5).astype(int)
        return 1 + strengths[axle]


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
