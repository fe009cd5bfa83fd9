"""What causes share that modulate adhesion periodically: a wave and its second harmonic."""

from abc import abstractmethod

import jax.numpy as jnp
import numpy as np

from adhesion_jax.effects.api import Conditions, Facts, Multiplier, Scalar, Values

AMPLITUDES = {
    name: ("1", -0.9, 0.9, f"amplitude of the {words}")
    for name, words in (
        *(("sine", "sine"), ("cosine", "cosine")),
        *(("sine2", "second sine"), ("cosine2", "second cosine")),
    )
}

#: A small wave without a second harmonic.
SMALL = {"sine": 0.03, "cosine": 0.03, "sine2": 0.0, "cosine2": 0.0}


class Wave(Multiplier):
    """mu (1 + a sin(p) + b cos(p) + a2 sin(2 p) + b2 cos(2 p)), p the phase.

    A wave may have any length: a spectrum of the residual along the column that it needs gives the
    starts.
    """

    sine: Scalar
    cosine: Scalar
    sine2: Scalar
    cosine2: Scalar

    @abstractmethod
    def phase(self, conditions: Conditions) -> Values:
        """Phase of the wave, rad."""

    @classmethod
    @abstractmethod
    def of_frequency(cls, frequency: float) -> "Wave":
        """A small wave; `frequency` in periods a unit of the column that it needs."""

    def factor(self, slip: Values, conditions: Conditions) -> Values:
        phase = self.phase(conditions)
        first = self.sine * jnp.sin(phase) + self.cosine * jnp.cos(phase)
        second = self.sine2 * jnp.sin(2 * phase) + self.cosine2 * jnp.cos(2 * phase)
        return 1 + first + second


class RailJoint(Wave):
    length: Scalar

    FACTS = Facts(
        source="Grassie 2009, Proc. IMechE F 223:581-596",
        described={
            **AMPLITUDES,
            "length": ("m", 0.5, 200.0, "distance from joint to joint"),
        },
        strengths=("sine", "cosine"),
        starts=tuple(
            {**SMALL, "length": length}
            for length in (10.0, 12.5, 15.0, 18.0, 20.0, 25.0, 30.0, 36.0)
        ),
        needs=("position_m",),
        sentence="Joints and corrugation modulate the adhesion along the track.",
        formula="mu (1 + wave(2 pi x/L)), a wave and its second harmonic, x in m, L the length "
        "of a rail",
        phrase="rail joints or corrugation",
        family="place",
        same_as=("periodic:position_m",),
    )

    def phase(self, conditions: Conditions) -> Values:
        return jnp.asarray(2 * jnp.pi * conditions["position_m"] / self.length)

    @classmethod
    def of_frequency(cls, frequency: float) -> Wave:
        return cls(0.01, 0.01, 0.0, 0.0, length=1 / frequency)


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
