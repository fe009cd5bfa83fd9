import jax.numpy as jnp

from adhesion_jax.effects.api import AdhesionTransform, Conditions, Facts, Scalar, Signal


class ContactHeating(AdhesionTransform):
    """The flash temperature is mu p0 v_s sqrt(a/V); pressure p0 and half axis a are in k."""

    k: Scalar

    FACTS = Facts(
        source="Ertz and Knothe 2002, Wear 253, 498-508",
        described={"k": ("sqrt(s/m)", -2.0, 20.0, "relative fall with heating")},
        strengths=("k",),
        starts=({"k": 0.1},),
        needs=("vehicle_speed_mps",),
        sentence="The contact heats and softens: adhesion falls with friction power.",
        formula="mu (1 - k |mu| v_s/sqrt(V)), v_s = |l| V the slip velocity and V the vehicle "
        "speed in m/s",
        phrase="contact heating",
        family="slip velocity",
        one_sided=True,
        rests_on=("slip_ratio", "vehicle_speed_mps"),
        same_as=("covariate:slip_velocity_mps",),
    )

    def after(self, adhesion: Signal, slip: Signal, conditions: Conditions) -> Signal:
        speed = jnp.maximum(conditions["vehicle_speed_mps"], 1e-3)
        heating = jnp.abs(adhesion) * jnp.abs(slip) * jnp.sqrt(speed)
        return adhesion * jnp.maximum(1 - self.k * heating, 0.0)
