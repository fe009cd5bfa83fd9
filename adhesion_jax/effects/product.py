"""Two columns that act together and not alone."""

from itertools import combinations

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from adhesion_jax.effects.api import Columns, Conditions, Form, Scalar, Values
from adhesion_jax.effects.shape import ShapeTerm
from adhesion_jax.effects.two_columns import at_corners


class Product(ShapeTerm):
    """g = k (y - y0) (z - z0)/(s_y s_z), y and z two columns, s their spreads.

    y0 and z0 are found with k, so that the term of one column alone is in it.
    """

    k: Scalar
    first_centre: Scalar
    second_centre: Scalar
    first_scale: Scalar
    second_scale: Scalar
    first: str = eqx.field(static=True)
    second: str = eqx.field(static=True)

    FACTS = Form(
        source="first mixed term of any smooth dependence",
        described={
            "k": ("1", -3.0, 3.0, "change of g per spread of both columns"),
            "first_centre": ("1", -1e12, 1e12, "centre of the first, in spreads"),
            "second_centre": ("1", -1e12, 1e12, "centre of the second, in spreads"),
            "first_scale": ("column", 1e-12, 1e12, "spread of the first"),
            "second_scale": ("column", 1e-12, 1e12, "spread of the second"),
        },
        strengths=("k",),
        references={"first_scale": "first", "second_scale": "second"},
        formula="g = k (y - y0) (z - z0)/(s_y s_z), y and z two columns, s their spreads",
        phrase="a joint dependence on {}",
    )

    def log_factor(self, conditions: Conditions) -> Values:
        first = conditions[self.first] / self.first_scale - self.first_centre
        second = conditions[self.second] / self.second_scale - self.second_centre
        return jnp.asarray(self.k * first * second)

    @classmethod
    def at_places(cls) -> np.ndarray:
        return 1.5**2 * at_corners((1, 1))

    @classmethod
    def starts(cls, columns: Columns) -> list[ShapeTerm]:
        scales = {name: float(np.std(z)) for name, z in columns.items()}
        centres = {name: float(np.mean(z)) / scales[name] for name, z in columns.items()}
        return [
            cls(0.02, centres[one], centres[other], scales[one], scales[other], one, other)
            for one, other in combinations(columns, 2)
        ]
