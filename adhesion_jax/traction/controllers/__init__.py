"""Controllers by name, those of a kind in a file."""

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

#: Those that may be named.
CONTROLLERS: Mapping[str, Controller] = {
    "none": NoControl(),
    "adaptive-robust": AdaptiveRobust(),
    "slope-feedback": SlopeFeedback(),
    "rate-feedback": RateFeedback(),
    "threshold": Threshold(),
    "barrier": Barrier(),
    "anticipating": Anticipating(),
    "sliding-mode": SlidingMode(),
    "sliding-mode-layer": SlidingMode(layer=0.05),
    "linearised-pi": LinearisedPI(),
    "differential-acceleration": DifferentialAcceleration(),
}
