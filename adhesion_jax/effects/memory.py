"""A column that acts with a memory."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from adhesion_jax.effects.api import Columns, Conditions, Form, Scalar, Values
from adhesion_jax.effects.history import lagged
from adhesion_jax.effects.shape import ShapeTerm


class Memory(ShapeTerm):
    """g = k (y - z0)/s with T y' + y = z, z any column, z0 its median and s its spread.

    A run starts settled.
    """

    k: Scalar
    time_constant: Scalar
    reference: Scalar
    scale: Scalar
    column: str = eqx.field(static=True)

    FACTS = Form(
        source="first-order lag",
        described={
            "k": ("1", -3.0, 3.0, "change of g per standard deviation of the column"),
            "time_constant": ("s", 1e-3, 1e4, "time constant of the memory"),
            "reference": ("column", -1e12, 1e12, "value at which nothing changes"),
            "scale": ("column", 1e-12, 1e12, "unit of the change"),
        },
        strengths=("k",),
        references={"reference": "column", "scale": "column"},
        formula="g = k (y - z0)/s, T y' + y = z, z any column, z0 its median",
        phrase="a dependence on {} with a memory",
    )

    def log_factor(self, conditions: Conditions) -> Values:
        seen = lagged(jnp.asarray(conditions[self.column]), self.time_constant, conditions)
        return jnp.asarray(self.k * (seen - self.reference) / self.scale)

    @classmethod
    def at_places(cls) -> np.ndarray:
        return np.linspace(-1.5, 1.5, 6)[:, None]

    @classmethod
    def starts(cls, columns: Columns) -> list[ShapeTerm]:
        return [
            cls(0.02, time, float(np.median(z)), float(np.std(z)), column=name)
            for name, z in columns.items()
            if np.ptp(z) > 0
            for time in (0.4, 1.2, 4.0)
        ]
