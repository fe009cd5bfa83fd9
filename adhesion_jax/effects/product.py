"""Two columns that act together and not alone."""

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns
from adhesion_jax.effects.shape import ShapeTerm
from adhesion_jax.effects.two_columns import at_corners

_SOURCE = "first mixed term of any smooth dependence"


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

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "k": Parameter("1", -3.0, 3.0, "change of g per spread of both columns", _SOURCE),
        "first_centre": Parameter("1", -1e12, 1e12, "centre of the first, in spreads", _SOURCE),
        "second_centre": Parameter("1", -1e12, 1e12, "centre of the second, in spreads", _SOURCE),
        "first_scale": Parameter("column", 1e-12, 1e12, "spread of the first", _SOURCE),
        "second_scale": Parameter("column", 1e-12, 1e12, "spread of the second", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("k",)
    REFERENCES: ClassVar[Mapping[str, str]] = {"first_scale": "first", "second_scale": "second"}
    FORMULA: ClassVar[str] = (
        "g = k (y - y0) (z - z0)/(s_y s_z), y and z two columns, s their spreads"
    )
    PHRASE: ClassVar[str] = "a joint dependence on {}"

    def log_factor(self, conditions: Conditions) -> Float[Array, "..."]:
        first = conditions[self.first] / self.first_scale - self.first_centre
        second = conditions[self.second] / self.second_scale - self.second_centre
        return jnp.asarray(self.k * first * second)

    @classmethod
    def at_places(cls) -> np.ndarray:
        return 1.5**2 * at_corners((1, 1))

    @classmethod
    def starts(cls, columns: Columns) -> Sequence["Product"]:
        scales = {name: float(np.std(z)) for name, z in columns.items()}
        centres = {name: float(np.mean(z)) / scales[name] for name, z in columns.items()}
        return [
            cls(0.02, centres[one], centres[other], scales[one], scales[other], one, other)
            for one, other in combinations(columns, 2)
        ]
