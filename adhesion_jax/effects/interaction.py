"""Two columns whose joint influence is more than a plain product."""

import equinox as eqx
import numpy as np

from adhesion_jax.effects.api import Columns, Conditions, Form, Scalar, Values
from adhesion_jax.effects.shape import ShapeTerm
from adhesion_jax.effects.two_columns import REFERENCES, SCALES, at_corners, legendre, pairs


class Interaction(ShapeTerm):
    """g = sum over i, j = 1, 2 of k_ij P_i(u) P_j(v), P the Legendre polynomials.

    u and v are the columns on -1 to 1 by the share of the data below them.
    """

    k11: Scalar
    k12: Scalar
    k21: Scalar
    k22: Scalar
    first_mean: Scalar
    first_spread: Scalar
    second_mean: Scalar
    second_spread: Scalar
    first: str = eqx.field(static=True)
    second: str = eqx.field(static=True)

    FACTS = Form(
        source="mixed terms of any smooth dependence up to the second degree in each column",
        described={
            **{
                f"k{i}{j}": ("1", -9.0, 9.0, f"weight of degrees {i} and {j}")
                for i in (1, 2)
                for j in (1, 2)
            },
            **SCALES,
        },
        strengths=("k11", "k12", "k21", "k22"),
        references=REFERENCES,
        formula="g = sum over i, j = 1, 2 of k_ij P_i(u) P_j(v), P the Legendre polynomials",
        phrase="a joint dependence on {}",
    )

    def log_factor(self, conditions: Conditions) -> Values:
        u, u2 = legendre(conditions[self.first], self.first_mean, self.first_spread)
        v, v2 = legendre(conditions[self.second], self.second_mean, self.second_spread)
        return u * (self.k11 * v + self.k12 * v2) + u2 * (self.k21 * v + self.k22 * v2)

    @classmethod
    def at_places(cls) -> np.ndarray:
        return at_corners((1, 1), (1, 2), (2, 1), (2, 2))

    @classmethod
    def starts(cls, columns: Columns) -> list[ShapeTerm]:
        return [cls(0.02, 0.0, 0.0, 0.0, *pair) for pair in pairs(columns)]
