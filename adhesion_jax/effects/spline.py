"""A column without a formula of its own: a smooth curve through the data."""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from adhesion_jax.effects.api import Columns, Conditions, Form, Scalar, Signal, Values
from adhesion_jax.effects.shape import ShapeTerm
from adhesion_jax.programs import kept

_KNOTS = np.linspace(0.0, 1.0, 6)


def _basis(place: Signal) -> Sequence[Signal]:
    """The five functions beside the constant, each zero in the middle of the range."""

    def cubic(u: Signal | float, j: int) -> Signal:
        cubes = jnp.maximum(u - _KNOTS[j], 0.0) ** 3 - jnp.maximum(u - _KNOTS[-1], 0.0) ** 3
        return cubes / (_KNOTS[-1] - _KNOTS[j])

    def basis(u: Signal | float) -> list[Signal]:
        last = cubic(u, _KNOTS.size - 2)
        return [jnp.asarray(u), *(cubic(u, j) - last for j in range(_KNOTS.size - 2))]

    u = jnp.clip(place, 0.0, 1.0)
    return [here - middle for here, middle in zip(basis(u), basis(0.5), strict=True)]


@kept()
def _basis_at(places: Float[ArrayLike, " places"]) -> Float[Array, "places functions"]:
    return jnp.stack(_basis(jnp.asarray(places)), axis=1)


class Spline(ShapeTerm):
    """g = s(u), s a natural cubic spline with six knots on u = (z - low)/(high - low).

    Outside [low, high] the column is held at the edge.
    """

    k1: Scalar
    k2: Scalar
    k3: Scalar
    k4: Scalar
    k5: Scalar
    low: Scalar
    high: Scalar
    column: str = eqx.field(static=True)

    FACTS = Form(
        source="Hastie, Tibshirani and Friedman 2009, The Elements of Statistical Learning, Eq. "
        "5.4 and 5.5",
        described={
            **{f"k{j}": ("1", -50.0, 50.0, f"weight of basis function {j}") for j in range(1, 6)},
            "low": ("column", -1e12, 1e12, "smallest value in the data"),
            "high": ("column", -1e12, 1e12, "largest value in the data"),
        },
        strengths=("k1", "k2", "k3", "k4", "k5"),
        references={"low": "column", "high": "column"},
        formula="g = s(u), s a natural cubic spline with six knots on u = (z - low)/(high - low)",
        phrase="a smooth dependence on {}",
    )

    def log_factor(self, conditions: Conditions) -> Values:
        basis = _basis(jnp.asarray((conditions[self.column] - self.low) / (self.high - self.low)))
        weights = (self.k1, self.k2, self.k3, self.k4, self.k5)
        terms = [weight * part for weight, part in zip(weights, basis, strict=True)]
        return jnp.sum(jnp.stack(terms), axis=0)

    @classmethod
    def at_places(cls) -> np.ndarray:
        return np.asarray(_basis_at(_KNOTS))

    @classmethod
    def starts(cls, columns: Columns) -> list[ShapeTerm]:
        ends = {name: (float(z.min()), float(z.max())) for name, z in columns.items()}
        return [
            cls(0.02, 0.02, 0.02, 0.02, 0.02, low=low, high=high, column=name)
            for name, (low, high) in ends.items()
            if high > low
        ]
