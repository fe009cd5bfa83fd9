"""A column without a formula of its own, taken as linear."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from adhesion_jax.effects.api import Columns, Conditions, Form, Scalar, Values
from adhesion_jax.effects.shape import ShapeTerm


class Covariate(ShapeTerm):
    """g = k (z - z0)/s, z any column, z0 its median and s its standard deviation."""

    k: Scalar
    reference: Scalar
    scale: Scalar
    column: str = eqx.field(static=True)

    FACTS = Form(
        source="first term of any smooth dependence",
        described={
            "k": ("1", -3.0, 3.0, "change of g per standard deviation of the column"),
            "reference": ("column", -1e12, 1e12, "value at which nothing changes"),
            "scale": ("column", 1e-12, 1e12, "unit of the change"),
        },
        strengths=("k",),
        references={"reference": "column", "scale": "column"},
        formula="g = k (z - z0)/s, z any column, z0 its median and s its standard deviation",
        phrase="a dependence on {}",
    )

    def log_factor(self, conditions: Conditions) -> Values:
        return jnp.asarray(self.k * (conditions[self.column] - self.reference) / self.scale)

    @classmethod
    def at_places(cls) -> np.ndarray:
        return np.linspace(-1.5, 1.5, 6)[:, None]

    @classmethod
    def starts(cls, columns: Columns) -> list[ShapeTerm]:
        return [
            cls(k=0.02, reference=float(np.median(z)), scale=float(np.std(z)), column=name)
            for name, z in columns.items()
        ]
