"""What functions of two columns share: both on -1 to 1 over their ranges, and their parameters."""

from collections.abc import Mapping
from itertools import combinations

import jax.numpy as jnp
import numpy as np

from adhesion_jax.effects.api import Columns, Scalar, Values

#: The ends of the ranges of both columns, and the columns they are references in.
ENDS: Mapping[str, tuple[str, float, float, str]] = {
    f"{place}_{end}": ("column", -1e12, 1e12, f"{end} end in the data")
    for place in ("first", "second")
    for end in ("low", "high")
}
REFERENCES: Mapping[str, str] = {name: name.split("_")[0] for name in ENDS}


def legendre(column: Values | float, low: Scalar, high: Scalar) -> tuple[Values, Values]:
    """P_1(u) and P_2(u), u the column on -1 to 1 over its range, held at the edges beyond."""
    place = jnp.clip(2 * (column - low) / (high - low) - 1, -1.0, 1.0)
    return place, 1.5 * place**2 - 0.5


def pairs(columns: Columns) -> list[tuple[float, float, float, float, str, str]]:
    """The ends of both ranges and both names, for every two columns that vary."""
    ends = {name: (float(z.min()), float(z.max())) for name, z in columns.items()}
    varying = [name for name, (low, high) in ends.items() if high > low]
    return [(*ends[one], *ends[other], one, other) for one, other in combinations(varying, 2)]


def at_corners(*degrees: tuple[int, int]) -> np.ndarray:
    """P_i(u) P_j(v) for each pair of degrees at u, v = -1, 0, 1, [nine, degrees]."""
    u, v = (side.ravel() for side in np.meshgrid([-1.0, 0.0, 1.0], [-1.0, 0.0, 1.0]))
    values = [(np.ones_like(place), place, 1.5 * place**2 - 0.5) for place in (u, v)]
    return np.stack([values[0][i] * values[1][j] for i, j in degrees], axis=1)
