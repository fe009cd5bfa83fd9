import jax.numpy as jnp

from adhesion_jax.effects.api import Conditions, Facts, Scalar, Signal, SlipTransform


class SlipBias(SlipTransform):
    """Burckhardt's curve changes as by a torque offset."""

    bias: Scalar

    FACTS = Facts(
        source="any odometry",
        described={"bias": ("1", -0.05, 0.05, "slip ratio that is missing")},
        strengths=("bias",),
        starts=({"bias": 5e-4},),
        needs=(),
        sentence="The wheel radius differs from the one that the slip was calculated with.",
        formula="mu(l + e sign(l)), e the bias of the slip ratio",
        phrase="a bias of the slip",
        family="offset",
        rests_on=("slip_ratio",),
        same_as=("torque_offset",),
        of_slip_alone=True,
    )

    def before(self, slip: Signal, conditions: Conditions) -> Signal:
        return slip + self.bias * jnp.sign(slip)
