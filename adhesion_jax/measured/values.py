"""A curve and its derivatives at many points, by one small program for each curve."""

from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Curve, with_free_values
from adhesion_jax.programs import QUICKLY, kept

#: Numbers of points that are evaluated at a time, the first that holds all of them, or the last:
#: the programs do not depend on the length of a record.
_AT_A_TIME = (1024, 4096, 16384)


class Values(NamedTuple):
    """Adhesion, and its derivatives by the slip and by the free parameters."""

    adhesion: Float[np.ndarray, " points"]
    by_slip: Float[np.ndarray, " points"]
    by_parameter: Float[np.ndarray, "points free"]


def values(
    curve: Curve,
    parameters: Float[np.ndarray, " free"],
    slip: Float[np.ndarray, " points"],
    conditions: Mapping[str, Float[np.ndarray, "..."] | float],
) -> Values:
    """The curve with these free parameters; conditions that it does not need are left out."""
    points = slip.size
    size = next((size for size in _AT_A_TIME if size >= points), _AT_A_TIME[-1])
    needed = {name: np.broadcast_to(conditions[name], slip.shape) for name in curve.NEEDS}
    found = np.empty((points, 2 + parameters.size))
    for first in range(0, points, size):
        some = slice(first, first + size)

        def filled(column: np.ndarray, some: slice = some) -> np.ndarray:
            part = column[some]
            return np.pad(part, (0, size - part.size), mode="edge")

        columns = {name: filled(column) for name, column in needed.items()}
        told = _values(curve, np.asarray(parameters, float), filled(slip), columns)
        found[some] = np.asarray(told)[: points - first]
    return Values(found[:, 0], found[:, 1], found[:, 2:])


def expected_values(
    curve: Curve,
    parameters: Float[np.ndarray, " free"],
    slip: Float[np.ndarray, " points"],
    variance: Float[np.ndarray, " points"],
    conditions: Mapping[str, Float[np.ndarray, "..."] | float],
) -> Values:
    """The means over a normal slip of this mean and variance, by Gauss and Hermite's three points.

    Exact for polynomials of the slip up to the fifth degree.
    """
    middle = values(curve, parameters, slip, conditions)
    if not variance.any():
        return middle
    reach = np.sqrt(3 * variance)
    sides = (values(curve, parameters, slip + side * reach, conditions) for side in (-1, 1))
    return Values(*((a + 4 * m + b) / 6 for m, a, b in zip(middle, *sides, strict=True)))


@kept(compiler={"xla_backend_optimization_level": "1", **QUICKLY})
def _values(
    curve: Curve,
    parameters: Float[Array, " free"],
    slip: Float[Array, " points"],
    conditions: Mapping[str, Float[Array, " points"]],
) -> Float[Array, "points columns"]:
    def adhesion(parameters: Array, slip: Array) -> Array:
        return with_free_values(curve, parameters)(slip, conditions)

    one = jnp.ones_like(slip)
    found, by_slip = jax.jvp(lambda slip: adhesion(parameters, slip), (slip,), (one,))
    by_parameter = jax.jacfwd(adhesion)(parameters, slip)
    return jnp.column_stack([found, by_slip, by_parameter])
