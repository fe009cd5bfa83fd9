"""A column without a formula of its own: a smooth curve through the data."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from adhesion_jax.effects.api import Columns, Conditions, Form, Scalar, Values
from adhesion_jax.effects.shape import ShapeTerm, share_below

_KNOTS = np.linspace(0.0, 1.0, 6)


def _natural(u: Any) -> list[Any]:
    """The five functions of Eq. 5.4 and 5.5 beside the constant, u from 0 to 1."""
    cubes = [((u - knot) * (u > knot)) ** 3 / (1 - knot) for knot in _KNOTS[:-1]]
    return [u, *(cube - cubes[-1] for cube in cubes[:-1])]


def _turned() -> np.ndarray:
    """What makes the functions uncorrelated and of variance one over u, the smoothest first."""
    grid = np.stack(_natural((np.arange(1000) + 0.5) / 1000), axis=1)
    return np.linalg.inv(np.linalg.qr(grid - grid.mean(axis=0))[1]) * len(grid) ** 0.5


_TURNED, _MIDDLE = _turned(), np.array(_natural(0.5))


class Spline(ShapeTerm):
    """g = s(u), s a natural cubic spline with six knots on the share u of the data below z.

    u is the logistic distribution of the mean and the standard deviation of the column.
    """

    k1: Scalar
    k2: Scalar
    k3: Scalar
    k4: Scalar
    k5: Scalar
    mean: Scalar
    spread: Scalar
    column: str = eqx.field(static=True)

    FACTS = Form(
        source="Hastie, Tibshirani and Friedman 2009, The Elements of Statistical Learning, Eq. "
        "5.4 and 5.5",
        described={
            **{f"k{j}": ("1", -50.0, 50.0, f"weight of basis function {j}") for j in range(1, 6)},
            "mean": ("column", -1e12, 1e12, "mean of the data"),
            "spread": ("column", 1e-12, 1e12, "standard deviation of the data"),
        },
        strengths=("k1", "k2", "k3", "k4", "k5"),
        references={"mean": "column", "spread": "column"},
        formula="g = s(u), s a natural cubic spline with six knots on the share u of data below z",
        phrase="a smooth dependence on {}",
    )

    def log_factor(self, conditions: Conditions) -> Values:
        weights = _TURNED @ jnp.stack([self.k1, self.k2, self.k3, self.k4, self.k5])
        functions = _natural(share_below(conditions[self.column], self.mean, self.spread))
        terms = zip(weights, functions, _MIDDLE, strict=True)
        return sum(weight * (one - middle) for weight, one, middle in terms)

    @classmethod
    def at_places(cls) -> np.ndarray:
        return (np.stack(_natural(_KNOTS), axis=1) - _MIDDLE) @ _TURNED

    @classmethod
    def starts(cls, columns: Columns) -> list[ShapeTerm]:
        return [
            cls(0.02, 0.02, 0.02, 0.02, 0.02, float(z.mean()), float(z.std()), column=name)
            for name, z in columns.items()
            if np.ptp(z) > 0
        ]
