"""What the file of an effect imports: its declarations, the classes it derives from, arrays."""

from adhesion_jax.curves import Conditions, Scalar
from adhesion_jax.effects.base import Columns, Effect, Form, Signal, Values
from adhesion_jax.effects.cause import AdhesionTransform, Cause, Facts, Multiplier, SlipTransform

__all__ = [
    "AdhesionTransform",
    "Cause",
    "Columns",
    "Conditions",
    "Effect",
    "Facts",
    "Form",
    "Multiplier",
    "Scalar",
    "Signal",
    "SlipTransform",
    "Values",
]
