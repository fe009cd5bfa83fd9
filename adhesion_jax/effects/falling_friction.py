import jax.numpy as jnp

from adhesion_jax.effects.api import Conditions, Facts, Multiplier, Scalar, Values


class FallingFriction(Multiplier):
    """In the source A = .4 and b = .6 s/m on dry rails, A = .4 and b = .2 s/m on wet ones."""

    drop: Scalar
    b: Scalar

    FACTS = Facts(
        source="Polach 2005, Wear 258, 992-1000",
        described={
            "drop": ("1", -0.5, 1.0, "share of friction lost at high slip velocity"),
            "b": ("s/m", 0.02, 20.0, "decay of friction with slip velocity"),
        },
        strengths=("drop",),
        starts=tuple({"drop": 0.05, "b": b} for b in (0.1, 0.3, 0.8, 2.0, 6.0)),
        needs=("vehicle_speed_mps",),
        sentence="Friction falls with slip velocity: Polach's law on any curve.",
        formula="mu (1 - d (1 - exp(-b w))), w = |l| V the slip velocity in m/s; d = 1 - A of "
        "the source",
        phrase="falling friction",
        family="slip velocity",
        one_sided=True,
        rests_on=("slip_ratio", "vehicle_speed_mps"),
        same_as=("covariate:slip_velocity_mps",),
    )

    def factor(self, slip: Values, conditions: Conditions) -> Values:
        slip_velocity = jnp.abs(slip) * conditions["vehicle_speed_mps"]
        return 1 + self.drop * jnp.expm1(-self.b * slip_velocity)
