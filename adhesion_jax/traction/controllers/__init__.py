"""Controllers by name: one method a file."""

from collections.abc import Mapping

from adhesion_jax.traction.controllers.adaptive_robust import AdaptiveRobust
from adhesion_jax.traction.controllers.anticipating import Anticipating
from adhesion_jax.traction.controllers.base import Controller
from adhesion_jax.traction.controllers.linearised import Barrier, LinearisedPI, SlidingMode
from adhesion_jax.traction.controllers.readhesion import (
    DifferentialAcceleration,
    NoControl,
    Threshold,
)
from adhesion_jax.traction.controllers.torque_feedback import RateFeedback, SlopeFeedback

#: Those that may be named, with settings.
CONTROLLERS: Mapping[str, Controller] = {
    "none": NoControl(),
    "adaptive-robust": AdaptiveRobust(
        gain=12500.0, adaptation=19.0, linear=0.0154, square=0.00467, layer=0.05
    ),
    "slope-feedback": SlopeFeedback(
        slope_gain=19000.0,
        adhesion_gain=18000.0,
        gamma=10.0,
        first_p=10.0,
        first_slope=0.3,
        filter_time=0.05,
    ),
    "rate-feedback": RateFeedback(
        rate_gain=19000.0, adhesion_gain=18000.0, filter_time=0.05, engaged=30 / 3.6
    ),
    "threshold": Threshold(difference=0.8, creepage=0.05, released=0.3, unloading=4.0, ramp=1600.0),
    "barrier": Barrier(gain=20.0, below=0.1, above=0.3, least=-0.3),
    "anticipating": Anticipating(gain=100.0, share=1.5, least=-0.3),
    "sliding-mode": SlidingMode(gain=1500.0, layer=0.0, least=-0.3),
    "sliding-mode-layer": SlidingMode(gain=1500.0, layer=0.05, least=-0.3),
    "linearised-pi": LinearisedPI(gain=20.0, integral_gain=20.0, least=-0.2),
    "differential-acceleration": DifferentialAcceleration(
        ramp=12e3,
        trip=1.0,
        released=0.3,
        calm=0.2,
        unloading=6.0,
        hold=0.1,
        haste=3.0,
        back=0.85,
        least=-0.15,
        filter_time=0.01,
    ),
}
