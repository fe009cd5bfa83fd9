"""A column that acts as a step, sudden or gradual."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from adhesion_jax.effects.api import Columns, Conditions, Form, Scalar, Values
from adhesion_jax.effects.shape import ShapeTerm


class Threshold(ShapeTerm):
    """g = k (tanh((z - c)/w) - tanh((z0 - c)/w)), z any column and z0 its median."""

    k: Scalar
    centre: Scalar
    width: Scalar
    reference: Scalar
    column: str = eqx.field(static=True)

    FACTS = Form(
        source="smooth transition: Granger and Teraesvirta 1993, Modelling Nonlinear Economic "
        "Relationships, section 2.3",
        described={
            "k": ("1", -3.0, 3.0, "half the log change over the step"),
            "centre": ("column", -1e12, 1e12, "middle of the step"),
            "width": ("column", 1e-12, 1e12, "half width of the step"),
            "reference": ("column", -1e12, 1e12, "value at which nothing changes"),
        },
        strengths=("k",),
        references={"reference": "column"},
        formula="g = k (tanh((z - c)/w) - tanh((z0 - c)/w)), z any column and z0 its median",
        phrase="a step over {}",
    )

    def log_factor(self, conditions: Conditions) -> Values:
        def step(z: Values | float | Scalar) -> Values:
            return jnp.tanh((z - self.centre) / self.width)

        return self.k * (step(conditions[self.column]) - step(self.reference))

    @classmethod
    def at_places(cls) -> np.ndarray:
        return np.linspace(-1.0, 1.0, 6)[:, None]

    @classmethod
    def starts(cls, columns: Columns) -> list[ShapeTerm]:
        return [
            cls(0.02, float(centre), 0.08 * float(np.ptp(z)), float(np.median(z)), name)
            for name, z in columns.items()
            if np.ptp(z) > 0
            for centre in np.unique(np.quantile(z, [0.15, 0.3, 0.5, 0.7, 0.85]))
        ]
