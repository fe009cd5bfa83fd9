"""Two columns beyond the catalogue: a smooth surface over both."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns
from adhesion_jax.effects.shape import ShapeTerm
from adhesion_jax.effects.two_columns import ENDS, REFERENCES, at_corners, legendre, pairs

_SOURCE = "any smooth function of two columns up to the second degree"


class Surface(ShapeTerm):
    """g = k10 P_1(u) + k01 P_1(v) + k20 P_2(u) + k11 P_1(u) P_1(v) + k02 P_2(v).

    P are the Legendre polynomials; u and v are the columns on -1 to 1 over their ranges, held at
    the edges beyond.
    """

    k10: Scalar
    k01: Scalar
    k20: Scalar
    k11: Scalar
    k02: Scalar
    first_low: Scalar
    first_high: Scalar
    second_low: Scalar
    second_high: Scalar
    first: str = eqx.field(static=True)
    second: str = eqx.field(static=True)

    STRENGTHS: ClassVar[tuple[str, ...]] = ("k10", "k01", "k20", "k11", "k02")
    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        **{
            name: Parameter("1", -9.0, 9.0, f"weight of degrees {name[1]} and {name[2]}", _SOURCE)
            for name in STRENGTHS
        },
        **ENDS,
    }
    REFERENCES: ClassVar[Mapping[str, str]] = REFERENCES
    FORMULA: ClassVar[str] = (
        "g = k10 P_1(u) + k01 P_1(v) + k20 P_2(u) + k11 P_1(u) P_1(v) + k02 P_2(v)"
    )
    PHRASE: ClassVar[str] = "a smooth dependence on {}"

    def log_factor(self, conditions: Conditions) -> Float[Array, "..."]:
        u, u2 = legendre(conditions[self.first], self.first_low, self.first_high)
        v, v2 = legendre(conditions[self.second], self.second_low, self.second_high)
        return self.k10 * u + self.k01 * v + self.k20 * u2 + self.k11 * u * v + self.k02 * v2

    @classmethod
    def at_places(cls) -> np.ndarray:
        return at_corners((1, 0), (0, 1), (2, 0), (1, 1), (0, 2))

    @classmethod
    def starts(cls, columns: Columns) -> Sequence["Surface"]:
        return [cls(0.02, 0.02, 0.02, 0.02, 0.02, *pair) for pair in pairs(columns)]
