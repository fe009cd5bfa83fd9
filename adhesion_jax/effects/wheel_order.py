import jax.numpy as jnp
import numpy as np

from adhesion_jax.effects.api import Conditions, Facts, Scalar, Values
from adhesion_jax.effects.wave import AMPLITUDES, SMALL, Wave


class WheelOrder(Wave):
    """Without an angle theta is the rolled distance over a nominal radius of .46 m.

    Then n is no whole number.
    """

    order: Scalar

    FACTS = Facts(
        source="Iwnicki 2006, Handbook of Railway Vehicle Dynamics, chapter 4",
        described={
            **AMPLITUDES,
            "order": ("1", 0.2, 40.0, "waves per turn"),
        },
        strengths=("sine", "cosine"),
        starts=tuple({**SMALL, "order": float(order)} for order in range(1, 7)),
        needs=("wheel_angle_rad",),
        sentence="A wheel out of round modulates the adhesion with its angle.",
        formula="mu (1 + wave(n theta)), a wave and its second harmonic, theta the wheel's angle "
        "in rad",
        phrase="a wave of the wheel's turns",
        family="wheel_order",
        same_as=("periodic:wheel_angle_rad",),
    )

    def phase(self, conditions: Conditions) -> Values:
        return jnp.asarray(self.order * conditions["wheel_angle_rad"])

    @classmethod
    def of_frequency(cls, frequency: float) -> Wave:
        return cls(0.01, 0.01, 0.0, 0.0, order=2 * np.pi * frequency)
