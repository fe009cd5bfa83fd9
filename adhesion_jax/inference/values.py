"""A curve that may bend, and its derivatives, at many points, by one small program a curve."""

from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Curve, with_free_values
from adhesion_jax.curves.bent import functions
from adhesion_jax.programs import QUICKLY, kept

#: Numbers of points that are evaluated at a time, the first that holds all of them, or the last:
#: the programs do not depend on the length of a record.
_AT_A_TIME = (1024, 4096, 16384)


class Span(NamedTuple):
    """Where the departure of a curve lives; see `curves.bent`."""

    reach: float
    largest: float


class Values(NamedTuple):
    """Adhesion, and its derivatives by the slip and by the parameters: free ones, then factors."""

    adhesion: Float[np.ndarray, " points"]
    by_slip: Float[np.ndarray, " points"]
    by_parameter: Float[np.ndarray, "points all"]


def values(
    curve: Curve,
    parameters: Float[np.ndarray, " all"],
    span: Span,
    slip: Float[np.ndarray, " points"],
    conditions: Mapping[str, Float[np.ndarray, "..."] | float],
) -> Values:
    """The curve with its departure; conditions that it does not need are ignored."""
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
        told = _values(curve, np.asarray(parameters, float), np.array(span), filled(slip), columns)
        found[some] = np.asarray(told)[: points - first]
    return Values(found[:, 0], found[:, 1], found[:, 2:])


def expected_values(
    curve: Curve,
    parameters: Float[np.ndarray, " all"],
    span: Span,
    slip: Float[np.ndarray, " points"],
    spread: Float[np.ndarray, " points"],
    conditions: Mapping[str, Float[np.ndarray, "..."] | float],
) -> Values:
    """The means over a normal slip of this mean and standard deviation.

    By Gauss and Hermite's three points: exact for polynomials of the slip up to the fifth degree.
    """
    middle = values(curve, parameters, span, slip, conditions)
    if not spread.any():
        return middle
    reach = np.sqrt(3) * spread
    low, high = (
        values(curve, parameters, span, slip + side, conditions) for side in (-reach, reach)
    )
    return Values(*((a + 4 * m + b) / 6 for m, a, b in zip(middle, low, high, strict=True)))


@kept(compiler={"xla_backend_optimization_level": "1", **QUICKLY})
def _values(
    curve: Curve,
    parameters: Float[Array, " all"],
    span: Float[Array, " 2"],
    slip: Float[Array, " points"],
    conditions: Mapping[str, Float[Array, " points"]],
) -> Float[Array, "points columns"]:
    free = len(curve.free)
    factors = parameters[free:]

    def bare(parameters: Array, slip: Array) -> Array:
        return with_free_values(curve, parameters)(slip, conditions)

    def departing(slip: Array) -> Array:
        return 1 + functions(slip, span[0], span[1]) @ factors

    one = jnp.ones_like(slip)
    adhesion, slope = jax.jvp(lambda slip: bare(parameters[:free], slip), (slip,), (one,))
    stretch, bend = jax.jvp(departing, (slip,), (one,))
    by_free = jax.jacfwd(bare)(parameters[:free], slip) * stretch[:, None]
    by_factor = adhesion[:, None] * functions(slip, span[0], span[1])
    of_slip = slope * stretch + adhesion * bend
    return jnp.column_stack([adhesion * stretch, of_slip, by_free, by_factor])
