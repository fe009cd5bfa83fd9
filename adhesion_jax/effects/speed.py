import jax.numpy as jnp

from adhesion_jax.effects.api import Conditions, Facts, Multiplier, Scalar, Values


def _curtius_kniffler(speed: Values | Scalar) -> Values:
    return jnp.asarray(7.5 / (44 + 3.6 * speed) + 0.161)


class Speed(Multiplier):
    """k = 1 is the law of Curtius and Kniffler itself."""

    k: Scalar
    reference: Scalar

    FACTS = Facts(
        source="Curtius and Kniffler 1950, Elektrische Bahnen 21:25",
        described={
            "k": ("1", -3.0, 5.0, "share of the law's fall with speed"),
            "reference": ("m/s", 0.0, 200.0, "speed at which nothing changes"),
        },
        strengths=("k",),
        starts=({"k": 0.1},),
        references={"reference": "vehicle_speed_mps"},
        needs=("vehicle_speed_mps",),
        sentence="Adhesion falls with the speed of travel.",
        formula="mu (1 + k (f(V)/f(V0) - 1)), f(V) = 7.5/(44 + V) + 0.161, V the vehicle speed "
        "in km/h",
        phrase="vehicle speed",
        family="slip velocity",
        one_sided=True,
        same_as=("covariate:vehicle_speed_mps",),
    )

    def factor(self, slip: Values, conditions: Conditions) -> Values:
        relative = _curtius_kniffler(conditions["vehicle_speed_mps"]) / _curtius_kniffler(
            self.reference
        )
        return 1 + self.k * (relative - 1)
