import jax.numpy as jnp

from adhesion_jax.effects.api import Conditions, Facts, Scalar, Values
from adhesion_jax.effects.wave import AMPLITUDES, SMALL, Wave


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
