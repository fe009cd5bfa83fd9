"""What functions of two columns share: both on -1 to 1 by shares of the data; their parameters."""

from collections.abc import Mapping
from itertools import combinations

import numpy as np

from adhesion_jax.effects.api import Columns, Scalar, Values
from adhesion_jax.effects.shape import share_below

#: The mean and the spread of both columns, and the columns they are references in.
SCALES: Mapping[str, tuple[str, float, float, str]] = {
    f"{place}_{name}": ("column", least, 1e12, f"{words} of the data")
    for place in ("first", "second")
    for name, least, words in (("mean", -1e12, "mean"), ("spread", 1e-12, "standard deviation"))
}
REFERENCES: Mapping[str, str] = {name: name.split("_")[0] for name in SCALES}


def legendre(column: Values | float, mean: Scalar, spread: Scalar) -> tuple[Values, Values]:
    """P_1(u) and P_2(u), u from -1 to 1 by the share of the data below the column."""
    place = 2 * share_below(column, mean, spread) - 1
    return place, 1.5 * place**2 - 0.5


def pairs(columns: Columns) -> list[tuple[float, float, float, float, str, str]]:
    """The means and spreads of both and both names, for every two columns that vary."""
    scales = {name: (float(z.mean()), float(z.std())) for name, z in columns.items() if np.ptp(z)}
    return [(*scales[one], *scales[other], one, other) for one, other in combinations(scales, 2)]


def at_corners(*degrees: tuple[int, int]) -> np.ndarray:
    """P_i(u) P_j(v) for each pair of degrees at u, v = -1, 0, 1, [nine, degrees]."""
    u, v = (side.ravel() for side in np.meshgrid([-1.0, 0.0, 1.0], [-1.0, 0.0, 1.0]))
    values = [(np.ones_like(place), place, 1.5 * place**2 - 0.5) for place in (u, v)]
    return np.stack([values[0][i] * values[1][j] for i, j in degrees], axis=1)
