import jax.numpy as jnp

from adhesion_jax.effects.api import Conditions, Facts, Multiplier, Scalar, Values


class LoadTransfer(Multiplier):
    """The adhesion is taken for the load at rest."""

    k: Scalar

    FACTS = Facts(
        source="Iwnicki 2006, Handbook of Railway Vehicle Dynamics, chapter 7",
        described={"k": ("s^2/m", -1.0, 1.0, "relative change with acceleration")},
        strengths=("k",),
        starts=({"k": 0.02},),
        needs=("acceleration_mps2",),
        sentence="Acceleration shifts load between axles.",
        formula="mu (1 + k a), a the acceleration of the vehicle in m/s^2",
        phrase="load transfer",
        family="load_transfer",
        same_as=("covariate:acceleration_mps2",),
    )

    def factor(self, slip: Values, conditions: Conditions) -> Values:
        return jnp.maximum(1 + self.k * conditions["acceleration_mps2"], 0.0)
