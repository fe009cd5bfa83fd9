"""A column that no effect of the catalogue knows, taken as linear."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.discovery.effects.base import Columns, Effect

_SOURCE = "first term of any smooth dependence"


class Covariate(Effect):
    """mu (1 + k (z - z0)/s), z any column, z0 its median and s its interquartile range or so."""

    k: Scalar
    reference: Scalar
    scale: Scalar
    column: str = eqx.field(static=True)

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "k": Parameter("1", -0.9, 0.9, "relative change a scale of the column", _SOURCE),
        "reference": Parameter("column", -1e12, 1e12, "value at which nothing changes", _SOURCE),
        "scale": Parameter("column", 1e-12, 1e12, "unit of the change", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("k",)
    REFERENCES: ClassVar[Mapping[str, str]] = {"reference": "column", "scale": "column"}
    NEEDS: ClassVar[tuple[str, ...]] = ()
    ORDER: ClassVar[int] = 1

    def before(
        self, slip: Float[Array, "*shape"], conditions: Conditions
    ) -> Float[Array, "*shape"]:
        return slip

    def after(
        self,
        adhesion: Float[Array, "*shape"],
        slip: Float[Array, "*shape"],
        conditions: Conditions,
    ) -> Float[Array, "*shape"]:
        change = self.k * (conditions[self.column] - self.reference) / self.scale
        return adhesion * jnp.maximum(1 + change, 0.0)

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [
            cls(k=0.02, reference=float(np.median(z)), scale=float(np.std(z)), column=name)
            for name, z in columns.items()
        ]
