import jax.numpy as jnp

from adhesion_jax.effects.api import AdhesionTransform, Conditions, Facts, Scalar, Signal


class TorqueOffset(AdhesionTransform):
    offset: Scalar

    FACTS = Facts(
        source="any measured driving torque",
        described={"offset": ("1", -0.5, 0.5, "adhesion that is added")},
        strengths=("offset",),
        starts=({"offset": 0.002},),
        needs=(),
        sentence="The force signal has an offset, such as the torque of losses.",
        formula="mu + b sign(l)",
        phrase="an offset of the force",
        family="offset",
        rests_on=("slip_ratio",),
        same_as=("slip_bias",),
        of_slip_alone=True,
    )

    def after(self, adhesion: Signal, slip: Signal, conditions: Conditions) -> Signal:
        return adhesion + self.offset * jnp.sign(slip)
