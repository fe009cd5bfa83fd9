"""A column without a formula of its own, taken as linear."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns
from adhesion_jax.effects.shape import ShapeTerm

_SOURCE = "first term of any smooth dependence"


class Covariate(ShapeTerm):
    """g = k (z - z0)/s, z any column, z0 its median and s its standard deviation."""

    k: Scalar
    reference: Scalar
    scale: Scalar
    column: str = eqx.field(static=True)

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "k": Parameter("1", -3.0, 3.0, "change of g per standard deviation of the column", _SOURCE),
        "reference": Parameter("column", -1e12, 1e12, "value at which nothing changes", _SOURCE),
        "scale": Parameter("column", 1e-12, 1e12, "unit of the change", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("k",)
    REFERENCES: ClassVar[Mapping[str, str]] = {"reference": "column", "scale": "column"}
    FORMULA: ClassVar[str] = (
        "g = k (z - z0)/s, z any column, z0 its median and s its standard deviation"
    )
    PHRASE: ClassVar[str] = "a dependence on {}"

    def log_factor(self, conditions: Conditions) -> Float[Array, "..."]:
        return jnp.asarray(self.k * (conditions[self.column] - self.reference) / self.scale)

    @classmethod
    def at_places(cls) -> np.ndarray:
        return np.linspace(-1.5, 1.5, 6)[:, None]

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[ShapeTerm]:
        return [
            cls(k=0.02, reference=float(np.median(z)), scale=float(np.std(z)), column=name)
            for name, z in columns.items()
        ]
