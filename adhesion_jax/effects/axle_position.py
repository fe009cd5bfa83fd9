import jax.numpy as jnp

from adhesion_jax.effects.api import Columns, Conditions, Effect, Facts, Multiplier, Scalar, Values


class AxlePosition(Multiplier):
    """Up to six axles; those beyond share the last."""

    k1: Scalar
    k2: Scalar
    k3: Scalar
    k4: Scalar
    k5: Scalar

    FACTS = Facts(
        source="Voltr and Lata 2015, Veh. Syst. Dyn. 53:605-618",
        described={
            "k1": ("1", -0.9, 3.0, "relative change at axle 1"),
            "k2": ("1", -0.9, 3.0, "relative change at axle 2"),
            "k3": ("1", -0.9, 3.0, "relative change at axle 3"),
            "k4": ("1", -0.9, 3.0, "relative change at axle 4"),
            "k5": ("1", -0.9, 3.0, "relative change at axle 5"),
        },
        strengths=("k1", "k2", "k3", "k4", "k5"),
        needs=("axle",),
        sentence="Leading axles run on a dirtier rail than those behind.",
        formula="mu (1 + k_j) at axle j; axle 0, the first label of the data, is the reference",
        phrase="position of the axle",
        family="axle",
        same_as=("covariate:axle",),
    )

    def factor(self, slip: Values, conditions: Conditions) -> Values:
        strengths = jnp.stack([jnp.zeros(()), self.k1, self.k2, self.k3, self.k4, self.k5])
        axle = jnp.clip(jnp.asarray(conditions["axle"]), 0, 5).astype(int)
        return 1 + strengths[axle]

    @classmethod
    def starts(cls, columns: Columns) -> list[Effect]:
        return [cls(k1=0.03, k2=0.03, k3=0.03, k4=0.03, k5=0.03)]
