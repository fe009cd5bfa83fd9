"""A curve with its departure: adhesion, its derivatives by one small program, and the peak."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Curve, with_free_values
from adhesion_jax.curves.bent import FUNCTIONS, Bent
from adhesion_jax.programs import QUICKLY, kept

#: Points of Gauss and Hermite's rule, in standard deviations over the root of 3.
_NODES = (0.0, -1.0, 1.0)

#: Rows whose sums are taken at a time: few enough for the cache, and for a product of matrices by
#: one thread, since threads that wait for each other took 30 times as long on a busy machine.
AT_A_TIME = 2700

#: Numbers of points that are evaluated at a time, the first that holds all of them, or the last:
#: the programs do not depend on the length of a record.
_SIZES = (900, AT_A_TIME, len(_NODES) * AT_A_TIME)

#: A slip of less noise than this share of the reach of a departure has the mean of an exact one:
#: they differ by about the square of it, relative.
_EXACT = 1e-8

#: The spread of slips that are known.
EXACTLY = np.zeros(1)

#: Orders of the functions of a departure, times pi.
_ORDERS = np.pi * (np.arange(FUNCTIONS) + 0.5)


class Span(NamedTuple):
    """Where the departure of a curve lives; see `curves.bent`."""

    reach: float
    largest: float


@dataclass(frozen=True)
class Values:
    """Adhesion, and its derivatives by the slip and by the parameters: free ones, then factors.

    Each is computed where it is asked for. With three slips a point they are means over a normal
    slip, by Gauss and Hermite's rule: exact for polynomials of the slip up to the fifth degree.
    """

    bare: Float[np.ndarray, "columns slips"]  # the curve, and derivatives by slip and free ones
    factors: Float[np.ndarray, " functions"]
    span: Span
    slip: Float[np.ndarray, " slips"]
    points: int

    @cached_property
    def adhesion(self) -> Float[np.ndarray, " points"]:
        return self._mean(self.bare[0] * self._stretch)

    @property
    def by_slip(self) -> Float[np.ndarray, " points"]:
        slope = self.bare[1] * self._stretch
        if self.factors.any():
            size = np.abs(self.slip)
            turn = np.where(size < self.span.largest, np.sign(self.slip), 0.0)
            turn /= (self.span.reach + size) * np.log1p(self.span.largest / self.span.reach)
            cosines = _multiples(np.cos(0.5 * np.pi * self._place), self._twice, 1.0)
            slope += self.bare[0] * turn * ((self.factors * _ORDERS) @ cosines)
        return self._mean(slope)

    @cached_property
    def by_parameter(self) -> Float[np.ndarray, "points all"]:
        free = self.bare[2:] * self._stretch
        return self._mean(np.concatenate([free, self.bare[0] * self._functions])).T

    def _mean(self, columns: Float[np.ndarray, "*more slips"]) -> Float[np.ndarray, "*more points"]:
        if self.slip.size == self.points:
            return columns
        middle, low, high = np.moveaxis(columns.reshape(*columns.shape[:-1], 3, -1), -2, 0)
        return (low + 4 * middle + high) / 6

    @cached_property
    def _place(self) -> Float[np.ndarray, " slips"]:
        size = np.minimum(np.abs(self.slip), self.span.largest)
        return np.log1p(size / self.span.reach) / np.log1p(self.span.largest / self.span.reach)

    @cached_property
    def _sine(self) -> Float[np.ndarray, " slips"]:
        return np.sin(0.5 * np.pi * self._place)

    @property
    def _twice(self) -> Float[np.ndarray, " slips"]:
        return 2 - 4 * self._sine**2

    @cached_property
    def _functions(self) -> Float[np.ndarray, "functions slips"]:
        """`curves.bent.functions`."""
        return _multiples(self._sine, self._twice, -1.0)

    @cached_property
    def _stretch(self) -> Float[np.ndarray, " slips"] | float:
        return 1 + self.factors @ self._functions if self.factors.any() else 1.0


def _multiples(
    first: Float[np.ndarray, " slips"], twice: Float[np.ndarray, " slips"], before: float
) -> Float[np.ndarray, "functions slips"]:
    """Sines or cosines of (j + 1/2) x, from the first of them and 2 cos x, by Chebyshev's rule."""
    found = np.empty((FUNCTIONS, first.size))
    found[0] = first
    np.multiply(twice - before, first, out=found[1])
    for j in range(2, FUNCTIONS):
        np.multiply(twice, found[j - 1], out=found[j])
        found[j] -= found[j - 2]
    return found


def _at_many(
    curve: Curve, free: np.ndarray, slip: np.ndarray, conditions: Mapping[str, np.ndarray]
) -> Float[np.ndarray, "columns slips"]:
    """The curve with its derivatives, some points at a time."""
    points = slip.size
    size = next((size for size in _SIZES if size >= points), _SIZES[-1])
    parts = []
    for first in range(0, points, size):
        some = slice(first, first + size)
        columns = {name: _filled(column[some], size) for name, column in conditions.items()}
        told = _bare(curve, np.asarray(free, float), _filled(slip[some], size), columns)
        parts.append(np.asarray(told)[:, : points - first])
    return parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)


def _filled(column: np.ndarray, size: int) -> np.ndarray:
    """The column, with its last number repeated up to this size."""
    lacking = size - column.size
    return np.pad(column, (0, lacking), mode="edge") if lacking else column


@kept(compiler={"xla_backend_optimization_level": "1", **QUICKLY})
def _bare(
    curve: Curve,
    free: Float[Array, " free"],
    slip: Float[Array, " points"],
    conditions: Mapping[str, Float[Array, " points"]],
) -> Float[Array, "columns points"]:
    def at(free: Array, slip: Array) -> Array:
        return with_free_values(curve, free)(slip, conditions)

    one = jnp.ones_like(slip)
    adhesion, slope = jax.jvp(lambda slip: at(free, slip), (slip,), (one,))
    return jnp.concatenate([jnp.stack([adhesion, slope]), jax.jacfwd(at)(free, slip).T])


#: Number of slips among which the largest adhesion is looked for; then three about it, at this
#: share of the distance to its neighbours.
_GRID, _NEARER = 1024, 0.1

#: A peak is not told from rounding where both neighbours, or the last slip, are lower by no more
#: than this share of the largest adhesion: the curve is level there.
_LEVEL = 1e-12


class FittedLaw(NamedTuple):
    """A curve with the values of its free parameters, then of the factors of its departure."""

    curve: Curve
    parameters: Float[np.ndarray, " all"]
    span: Span
    conditions: Mapping[str, float]

    @property
    def bent(self) -> Bent:
        """The law itself, a function of slip and conditions."""
        count = len(self.curve.free)
        curve = with_free_values(self.curve, self.parameters[:count])
        return Bent(curve, self.parameters[count:], *self.span)

    def at(
        self,
        slip: Float[np.ndarray, " points"],
        spread: Float[np.ndarray, " points"] = EXACTLY,
        conditions: Mapping[str, Float[np.ndarray, "..."] | float] | None = None,
    ) -> Values:
        """Adhesion with its derivatives, under the conditions of the law if there are no others.

        With a spread they are the means over a normal slip of this mean and standard deviation.
        """
        slips = slip
        if spread.max() > _EXACT * self.span.reach:
            reach = np.sqrt(3) * spread
            slips = np.concatenate([slip + node * reach for node in _NODES])
        given = self.conditions if conditions is None else conditions
        needed = {
            name: np.resize(np.broadcast_to(given[name], slip.shape), slips.shape)
            for name in self.curve.NEEDS
        }
        free, factors = np.split(self.parameters, [len(self.curve.free)])
        bare = _at_many(self.curve, free, slips, needed)
        return Values(bare, factors, self.span, slips, slip.size)


class LawPeak(NamedTuple):
    """The largest adhesion for slips from 0 to a limit, and derivatives by the parameters."""

    slip: float
    adhesion: float
    found: bool  # whether it lies inside that range
    by_law: Float[np.ndarray, " all"]  # of the adhesion
    by_slip: Float[np.ndarray, " all"]  # of the slip


def peak_of(law: FittedLaw, limit: float) -> LawPeak:
    """By a grid that is dense where the curve rises, then by parabolas through three points.

    Without a peak within the limit it is the adhesion there, as for a curve that becomes level. A
    peak among the points counts, whether or not the law rises higher where there are none.
    """
    middle = min(5 * law.span.reach, 0.5 * limit)
    even = np.linspace(0.0, 1.0, _GRID) * limit / (limit + middle)
    slips = even * middle / (1 - even)
    found = law.at(slips)
    adhesion, slopes = found.adhesion, found.by_parameter
    heights = np.where(np.isfinite(adhesion), adhesion, -np.inf)
    within = int(np.searchsorted(slips, law.span.largest, side="right"))
    if np.argmax(heights[:within]) < within - 1:
        heights = heights[:within]
    top = int(np.argmax(heights))
    near = slice(max(top - 1, 0), top + 2)
    level = heights[top] - _LEVEL * abs(heights[top])
    if level <= max(heights[-1], np.min(heights[near])):
        top = _GRID - 1
    if top in (0, _GRID - 1):
        return LawPeak(slips[top], adhesion[top], False, slopes[top], 0 * slopes[top])
    at, _, _ = _vertex(slips[near], adhesion[near])
    closer = at + _NEARER * 0.5 * (slips[top + 1] - slips[top - 1]) * np.array([-1.0, 0.0, 1.0])
    found = law.at(closer)
    at, weights, tilt = _vertex(closer, found.adhesion)
    slopes = found.by_parameter
    return LawPeak(at, float(weights @ found.adhesion), True, weights @ slopes, tilt @ slopes)


def _vertex(slips: np.ndarray, heights: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Of the parabola through three points, its vertex, and the derivatives by the three heights.

    First those of its largest value, which also give that value, then those of its place.
    """
    a, b, c = slips - slips[1]
    square = np.array([1 / ((a - b) * (a - c)), 1 / ((b - a) * (b - c)), 1 / ((c - a) * (c - b))])
    slope = -square * np.array([b + c, a + c, a + b])
    bend = 2 * square @ heights
    at = -(slope @ heights) / bend
    weights = square * np.array([(at - b) * (at - c), (at - a) * (at - c), (at - a) * (at - b)])
    return float(at + slips[1]), weights, -(2 * square * at + slope) / bend
