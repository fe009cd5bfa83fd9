"""What the file of an effect imports: its declarations, the classes it derives from, arrays."""

from adhesion_jax.curves import Conditions, Scalar
from adhesion_jax.effects.base import Columns, Effect, Form, Signal, Values
from adhesion_jax.effects.cause import Bending, Cause, Changing, Facts, Scaling

__all__ = [
    "Bending",
    "Cause",
    "Changing",
    "Columns",
    "Conditions",
    "Effect",
    "Facts",
    "Form",
    "Scalar",
    "Scaling",
    "Signal",
    "Values",
]
