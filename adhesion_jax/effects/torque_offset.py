import jax.numpy as jnp

from adhesion_jax.effects.api import (
    AdhesionTransform,
    Columns,
    Conditions,
    Effect,
    Facts,
    Scalar,
    Signal,
)


class TorqueOffset(AdhesionTransform):
    offset: Scalar

    FACTS = Facts(
        source="any measured driving torque",
        described={"offset": ("1", -0.5, 0.5, "adhesion that is added")},
        strengths=("offset",),
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

    @classmethod
    def starts(cls, columns: Columns) -> list[Effect]:
        return [cls(offset=0.002)]
