"""A column without a formula of its own: a smooth curve through the data."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns
from adhesion_jax.effects.shape import ShapeTerm
from adhesion_jax.programs import kept

_SOURCE = "Hastie, Tibshirani and Friedman 2009, The Elements of Statistical Learning, Eq. 5.4"
_KNOTS = np.linspace(0.0, 1.0, 6)


def _basis(place: Float[Array, "*shape"]) -> Sequence[Float[Array, "*shape"]]:
    """The five functions beside the constant, each zero in the middle of the range."""

    def cubic(u: Float[Array, "*shape"] | float, j: int) -> Float[Array, "*shape"]:
        cubes = jnp.maximum(u - _KNOTS[j], 0.0) ** 3 - jnp.maximum(u - _KNOTS[-1], 0.0) ** 3
        return cubes / (_KNOTS[-1] - _KNOTS[j])

    def basis(u: Float[Array, "*shape"] | float) -> list[Float[Array, "*shape"]]:
        last = cubic(u, _KNOTS.size - 2)
        return [jnp.asarray(u), *(cubic(u, j) - last for j in range(_KNOTS.size - 2))]

    u = jnp.clip(place, 0.0, 1.0)
    return [here - middle for here, middle in zip(basis(u), basis(0.5), strict=True)]


@kept()
def _basis_at(places: Float[ArrayLike, " places"]) -> Float[Array, "places functions"]:
    return jnp.stack(_basis(jnp.asarray(places)), axis=1)


class Spline(ShapeTerm):
    """g = s(u), s a natural cubic spline with six knots on u = (z - low)/(high - low).

    Outside [low, high] the column is held at the edge. Source: Hastie et al. 2009, Eq. 5.4 and 5.5.
    """

    k1: Scalar
    k2: Scalar
    k3: Scalar
    k4: Scalar
    k5: Scalar
    low: Scalar
    high: Scalar
    column: str = eqx.field(static=True)

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        **{
            f"k{j}": Parameter("1", -50.0, 50.0, f"weight of basis function {j}", _SOURCE)
            for j in range(1, 6)
        },
        "low": Parameter("column", -1e12, 1e12, "smallest value in the data", _SOURCE),
        "high": Parameter("column", -1e12, 1e12, "largest value in the data", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("k1", "k2", "k3", "k4", "k5")
    REFERENCES: ClassVar[Mapping[str, str]] = {"low": "column", "high": "column"}
    FORMULA: ClassVar[str] = (
        "g = s(u), s a natural cubic spline with six knots on u = (z - low)/(high - low)"
    )
    PHRASE: ClassVar[str] = "a smooth dependence on {}"

    def log_factor(self, conditions: Conditions) -> Float[Array, "..."]:
        basis = _basis(jnp.asarray((conditions[self.column] - self.low) / (self.high - self.low)))
        weights = (self.k1, self.k2, self.k3, self.k4, self.k5)
        terms = [weight * part for weight, part in zip(weights, basis, strict=True)]
        return jnp.sum(jnp.stack(terms), axis=0)

    @classmethod
    def at_places(cls) -> np.ndarray:
        return np.asarray(_basis_at(_KNOTS))

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[ShapeTerm]:
        ends = {name: (float(z.min()), float(z.max())) for name, z in columns.items()}
        return [
            cls(0.02, 0.02, 0.02, 0.02, 0.02, low=low, high=high, column=name)
            for name, (low, high) in ends.items()
            if high > low
        ]
