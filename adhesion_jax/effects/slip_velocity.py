"""Causes that go with the vehicle speed or with the slip velocity."""

from functools import partial

import jax.numpy as jnp

from adhesion_jax.effects.api import (
    AdhesionTransform,
    Conditions,
    Facts,
    Multiplier,
    Scalar,
    Signal,
    Values,
)


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


#: What the facts of a fall with the slip velocity have in common.
_of_slip_velocity = partial(
    Facts,
    needs=("vehicle_speed_mps",),
    family="slip velocity",
    one_sided=True,
    rests_on=("slip_ratio", "vehicle_speed_mps"),
    same_as=("covariate:slip_velocity_mps",),
)


class SlipSpeed(Multiplier):
    """c4 is about .02 to .04 s/m."""

    c4: Scalar

    FACTS = _of_slip_velocity(
        source="Burckhardt 1993; He et al. 2018, Eq. 4",
        described={"c4": ("s/m", -0.2, 2.0, "fall with slip velocity")},
        strengths=("c4",),
        starts=({"c4": 0.01},),
        sentence="Adhesion falls with slip velocity: Burckhardt's c4.",
        formula="mu exp(-c4 |l| V), l the slip ratio, V the vehicle speed in m/s",
        phrase="exponential loss with slip velocity",
    )

    def factor(self, slip: Values, conditions: Conditions) -> Values:
        return jnp.exp(-self.c4 * jnp.abs(slip) * conditions["vehicle_speed_mps"])


class FallingFriction(Multiplier):
    """In the source A = .4 and b = .6 s/m on dry rails, A = .4 and b = .2 s/m on wet ones."""

    drop: Scalar
    b: Scalar

    FACTS = _of_slip_velocity(
        source="Polach 2005, Wear 258, 992-1000",
        described={
            "drop": ("1", -0.5, 1.0, "share of friction lost at high slip velocity"),
            "b": ("s/m", 0.02, 20.0, "decay of friction with slip velocity"),
        },
        strengths=("drop",),
        starts=tuple({"drop": 0.05, "b": b} for b in (0.1, 0.3, 0.8, 2.0, 6.0)),
        sentence="Friction falls with slip velocity: Polach's law on any curve.",
        formula="mu (1 - d (1 - exp(-b w))), w = |l| V the slip velocity in m/s; d = 1 - A of "
        "the source",
        phrase="falling friction",
    )

    def factor(self, slip: Values, conditions: Conditions) -> Values:
        slip_velocity = jnp.abs(slip) * conditions["vehicle_speed_mps"]
        return 1 + self.drop * jnp.expm1(-self.b * slip_velocity)


class ContactHeating(AdhesionTransform):
    """The flash temperature is mu p0 v_s sqrt(a/V); pressure p0 and half axis a are in k."""

    k: Scalar

    FACTS = _of_slip_velocity(
        source="Ertz and Knothe 2002, Wear 253, 498-508",
        described={"k": ("sqrt(s/m)", -2.0, 20.0, "relative fall with heating")},
        strengths=("k",),
        starts=({"k": 0.1},),
        sentence="The contact heats and softens: adhesion falls with friction power.",
        formula="mu (1 - k |mu| v_s/sqrt(V)), v_s = |l| V the slip velocity and V the vehicle "
        "speed in m/s",
        phrase="contact heating",
    )
    ORDER = 2

    def after(self, adhesion: Signal, slip: Signal, conditions: Conditions) -> Signal:
        speed = jnp.maximum(conditions["vehicle_speed_mps"], 1e-3)
        heating = jnp.abs(adhesion) * jnp.abs(slip) * jnp.sqrt(speed)
        return adhesion * jnp.maximum(1 - self.k * heating, 0.0)
