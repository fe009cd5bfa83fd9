"""Forms of effects over two columns."""

from collections.abc import Mapping
from itertools import combinations

import equinox as eqx
import numpy as np

from adhesion_jax.effects.api import Columns, Conditions, Form, Scalar, Values
from adhesion_jax.effects.shape import ShapeTerm, share_below

#: The mean and the spread of both columns, and the columns they are references in.
SCALES: Mapping[str, tuple[str, float, float, str]] = {
    f"{place}_{name}": ("column", least, 1e12, f"{words} of the data")
    for place in ("first", "second")
    for name, least, words in (("mean", -1e12, "mean"), ("spread", 1e-12, "standard deviation"))
}
REFERENCES: Mapping[str, str] = {name: name.split("_")[0] for name in SCALES}


def legendre(column: Values | float, mean: Scalar, spread: Scalar) -> tuple[Values, Values, Values]:
    """P_1(u), P_2(u) and P_3(u), u from -1 to 1 by the share of the data below the column."""
    place = 2 * share_below(column, mean, spread) - 1
    return place, 1.5 * place**2 - 0.5, (2.5 * place**2 - 1.5) * place


def pairs(columns: Columns) -> list[tuple[float, float, float, float, str, str]]:
    """The means and spreads of both and both names, for every two columns that vary."""
    scales = {name: (float(z.mean()), float(z.std())) for name, z in columns.items() if np.ptp(z)}
    return [(*scales[one], *scales[other], one, other) for one, other in combinations(scales, 2)]


def on_grid(*degrees: tuple[int, int]) -> np.ndarray:
    """P_i(u) P_j(v) for each pair of degrees, where u and v are evenly spaced from -1 to 1.

    Returns [places, degrees], with as many places a side as tell polynomials of the largest degree.
    """
    count = 1 + max(max(pair) for pair in degrees)
    side = np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, count), count - 1)
    values = side[:, None, :, None] * side[None, :, None, :]
    return np.stack([values[:, :, i, j].ravel() for i, j in degrees], axis=1)


#: Degrees of the polynomials in u and in v that two columns share.
_MIXED = tuple((i, j) for i in (1, 2, 3) for j in (1, 2, 3))


class Interaction(ShapeTerm):
    """g = sum over i, j = 1, 2, 3 of k_ij P_i(u) P_j(v), P the Legendre polynomials.

    u and v are the columns on -1 to 1 by the share of the data below them.
    """

    k11: Scalar
    k12: Scalar
    k13: Scalar
    k21: Scalar
    k22: Scalar
    k23: Scalar
    k31: Scalar
    k32: Scalar
    k33: Scalar
    first_mean: Scalar
    first_spread: Scalar
    second_mean: Scalar
    second_spread: Scalar
    first: str = eqx.field(static=True)
    second: str = eqx.field(static=True)

    FACTS = Form(
        source="mixed terms of any smooth dependence up to the third degree in each column",
        described={
            **{f"k{i}{j}": ("1", -9.0, 9.0, f"weight of degrees {i} and {j}") for i, j in _MIXED},
            **SCALES,
        },
        strengths=tuple(f"k{i}{j}" for i, j in _MIXED),
        references=REFERENCES,
        formula="g = sum over i, j = 1, 2, 3 of k_ij P_i(u) P_j(v), P the Legendre polynomials",
        phrase="a joint dependence on {}",
    )

    def log_factor(self, conditions: Conditions) -> Values:
        u = legendre(conditions[self.first], self.first_mean, self.first_spread)
        v = legendre(conditions[self.second], self.second_mean, self.second_spread)
        return sum(getattr(self, f"k{i}{j}") * u[i - 1] * v[j - 1] for i, j in _MIXED)

    @classmethod
    def at_places(cls) -> np.ndarray:
        return on_grid(*_MIXED)

    @classmethod
    def starts(cls, columns: Columns) -> list[ShapeTerm]:
        small = 9 * (0.02,)
        return [cls(*small, *pair) for pair in pairs(columns)]


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
        u, u2, _ = legendre(conditions[self.first], self.first_mean, self.first_spread)
        v, v2, _ = legendre(conditions[self.second], self.second_mean, self.second_spread)
        return self.k10 * u + self.k01 * v + self.k20 * u2 + self.k11 * u * v + self.k02 * v2

    @classmethod
    def at_places(cls) -> np.ndarray:
        return on_grid(*_DEGREES)

    @classmethod
    def starts(cls, columns: Columns) -> list[ShapeTerm]:
        return [cls(0.02, 0.02, 0.02, 0.02, 0.02, *pair) for pair in pairs(columns)]
