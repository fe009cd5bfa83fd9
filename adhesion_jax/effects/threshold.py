"""A column that acts as a step, sudden or gradual."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns
from adhesion_jax.effects.shape import ShapeTerm

_SOURCE = "Granger and Teraesvirta 1993, Modelling Nonlinear Economic Relationships, section 2.3"


class Threshold(ShapeTerm):
    """g = k (tanh((z - c)/w) - tanh((z0 - c)/w)), z any column and z0 its median.

    Source: the smooth transition of Granger and Teraesvirta 1993.
    """

    k: Scalar
    centre: Scalar
    width: Scalar
    reference: Scalar
    column: str = eqx.field(static=True)

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "k": Parameter("1", -3.0, 3.0, "half the log change over the step", _SOURCE),
        "centre": Parameter("column", -1e12, 1e12, "middle of the step", _SOURCE),
        "width": Parameter("column", 1e-12, 1e12, "half width of the step", _SOURCE),
        "reference": Parameter("column", -1e12, 1e12, "value at which nothing changes", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("k",)
    REFERENCES: ClassVar[Mapping[str, str]] = {"reference": "column"}
    FORMULA: ClassVar[str] = (
        "g = k (tanh((z - c)/w) - tanh((z0 - c)/w)), z any column and z0 its median"
    )
    PHRASE: ClassVar[str] = "a step over {}"

    def log_factor(self, conditions: Conditions) -> Float[Array, "..."]:
        def step(z: Float[Array, "..."] | float | Scalar) -> Float[Array, "..."]:
            return jnp.tanh((z - self.centre) / self.width)

        return self.k * (step(conditions[self.column]) - step(self.reference))

    @classmethod
    def at_places(cls) -> np.ndarray:
        return np.linspace(-1.0, 1.0, 6)[:, None]

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[ShapeTerm]:
        return [
            cls(0.02, float(centre), 0.08 * float(np.ptp(z)), float(np.median(z)), name)
            for name, z in columns.items()
            if np.ptp(z) > 0
            for centre in np.unique(np.quantile(z, [0.15, 0.3, 0.5, 0.7, 0.85]))
        ]
