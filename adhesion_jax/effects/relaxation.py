import jax.numpy as jnp

from adhesion_jax.effects.api import Conditions, Facts, Scalar, Values
from adhesion_jax.effects.dynamic import Lagging


class Relaxation(Lagging):
    length: Scalar

    FACTS = Facts(
        source="Pacejka 2012, Tire and Vehicle Dynamics, chapter 7",
        described={"length": ("m", 0.0, 100.0, "relaxation length")},
        strengths=("length",),
        starts=tuple({"length": length} for length in (0.3, 1.0, 3.0, 10.0)),
        needs=("vehicle_speed_mps", "time_s"),
        sentence="The contact takes a distance, not a time, to build up force.",
        formula="(s/V) dmu/dt + mu = mu_steady, s the relaxation length in m, V the vehicle "
        "speed in m/s",
        phrase="relaxation of the contact",
        family="in time",
    )

    def time(self, conditions: Conditions) -> Values:
        return self.length / jnp.maximum(conditions["vehicle_speed_mps"], 0.1)
