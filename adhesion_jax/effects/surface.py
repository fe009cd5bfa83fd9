"""Two columns beyond the catalogue: a smooth surface over both."""

import equinox as eqx
import numpy as np

from adhesion_jax.effects.api import Columns, Conditions, Form, Scalar, Values
from adhesion_jax.effects.shape import ShapeTerm
from adhesion_jax.effects.two_columns import REFERENCES, SCALES, at_corners, legendre, pairs

#: Degrees of the polynomials in u and in v.
_DEGREES = ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2))


class Surface(ShapeTerm):
    """g = k10 P_1(u) + k01 P_1(v) + k20 P_2(u) + k11 P_1(u) P_1(v) + k02 P_2(v).

    P are the Legendre polynomials; u and v are the columns on -1 to 1
    by the share of the data below them.
    """

    k10: Scalar
    k01: Scalar
    k20: Scalar
    k11: Scalar
    k02: Scalar
    first_mean: Scalar
    first_spread: Scalar
    second_mean: Scalar
    second_spread: Scalar
    first: str = eqx.field(static=True)
    second: str = eqx.field(static=True)

    FACTS = Form(
        source="any smooth function of two columns up to the second degree",
        described={
            **{f"k{i}{j}": ("1", -9.0, 9.0, f"weight of degrees {i} and {j}") for i, j in _DEGREES},
            **SCALES,
        },
        strengths=tuple(f"k{i}{j}" for i, j in _DEGREES),
        references=REFERENCES,
        formula="g = k10 P_1(u) + k01 P_1(v) + k20 P_2(u) + k11 P_1(u) P_1(v) + k02 P_2(v)",
        phrase="a smooth dependence on {}",
    )

    def log_factor(self, conditions: Conditions) -> Values:
        u, u2 = legendre(conditions[self.first], self.first_mean, self.first_spread)
        v, v2 = legendre(conditions[self.second], self.second_mean, self.second_spread)
        return self.k10 * u + self.k01 * v + self.k20 * u2 + self.k11 * u * v + self.k02 * v2

    @classmethod
    def at_places(cls) -> np.ndarray:
        return at_corners(*_DEGREES)

    @classmethod
    def starts(cls, columns: Columns) -> list[ShapeTerm]:
        return [cls(0.02, 0.02, 0.02, 0.02, 0.02, *pair) for pair in pairs(columns)]
