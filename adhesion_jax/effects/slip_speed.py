import jax.numpy as jnp

from adhesion_jax.effects.api import Conditions, Facts, Multiplier, Scalar, Values


class SlipSpeed(Multiplier):
    """c4 is about .02 to .04 s/m."""

    c4: Scalar

    FACTS = Facts(
        source="Burckhardt 1993; He et al. 2018, Eq. 4",
        described={"c4": ("s/m", -0.2, 2.0, "fall with slip velocity")},
        strengths=("c4",),
        starts=({"c4": 0.01},),
        needs=("vehicle_speed_mps",),
        sentence="Adhesion falls with slip velocity: Burckhardt's c4.",
        formula="mu exp(-c4 |l| V), l the slip ratio, V the vehicle speed in m/s",
        phrase="exponential loss with slip velocity",
        family="slip velocity",
        one_sided=True,
        rests_on=("slip_ratio", "vehicle_speed_mps"),
        same_as=("covariate:slip_velocity_mps",),
    )

    def factor(self, slip: Values, conditions: Conditions) -> Values:
        return jnp.exp(-self.c4 * jnp.abs(slip) * conditions["vehicle_speed_mps"])
