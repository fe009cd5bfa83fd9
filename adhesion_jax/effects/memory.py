"""A column that acts with a memory."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns
from adhesion_jax.effects.history import has_history, lagged
from adhesion_jax.effects.shape import ShapeTerm

_SOURCE = "first-order lag"


class Memory(ShapeTerm):
    """g = k (y - z0)/s with T y' + y = z, z any column, z0 its median and s its spread.

    A run starts settled.
    """

    k: Scalar
    time_constant: Scalar
    reference: Scalar
    scale: Scalar
    column: str = eqx.field(static=True)

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "k": Parameter("1", -3.0, 3.0, "change of g per standard deviation of the column", _SOURCE),
        "time_constant": Parameter("s", 1e-3, 1e4, "time constant of the memory", _SOURCE),
        "reference": Parameter("column", -1e12, 1e12, "value at which nothing changes", _SOURCE),
        "scale": Parameter("column", 1e-12, 1e12, "unit of the change", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("k",)
    REFERENCES: ClassVar[Mapping[str, str]] = {"reference": "column", "scale": "column"}
    FORMULA: ClassVar[str] = "g = k (y - z0)/s, T y' + y = z, z any column, z0 its median"
    PHRASE: ClassVar[str] = "a dependence on {} with a memory"

    def log_factor(self, conditions: Conditions) -> Float[Array, "..."]:
        z = jnp.asarray(conditions[self.column])
        time = jnp.asarray(self.time_constant)
        seen = lagged(z, time, conditions) if has_history(conditions) else z
        return jnp.asarray(self.k * (seen - self.reference) / self.scale)

    @classmethod
    def at_places(cls) -> np.ndarray:
        return np.linspace(-1.5, 1.5, 6)[:, None]

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[ShapeTerm]:
        return [
            cls(0.02, time, float(np.median(z)), float(np.std(z)), column=name)
            for name, z in columns.items()
            if np.ptp(z) > 0
            for time in (0.4, 1.2, 4.0)
        ]
