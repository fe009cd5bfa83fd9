"""A fitted curve with its departure: adhesion, derivatives, and the peak."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from adhesion_jax.curves import Curve, with_free_values
from adhesion_jax.curves.bent import Bent
from adhesion_jax.inference.values import Span, Values, values

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

    def at(self, slip: Float[np.ndarray, " points"]) -> Values:
        """Adhesion with its derivatives, under the conditions of the law."""
        return values(self.curve, self.parameters, self.span, slip, self.conditions)


class LawPeak(NamedTuple):
    """The largest adhesion for slips from 0 to a limit, and derivatives by the parameters."""

    slip: float
    adhesion: float
    found: bool  # whether it lies inside that range
    by_law: Float[np.ndarray, " all"]  # of the adhesion
    by_slip: Float[np.ndarray, " all"]  # of the slip


def peak_of(law: FittedLaw, limit: float) -> LawPeak:
    """By a grid that is dense where the curve rises, then by parabolas through three points.

    Without a peak within the limit it is the adhesion there, as for a curve that becomes level.
    """
    middle = min(5 * law.span.reach, 0.5 * limit)
    even = np.linspace(0.0, 1.0, _GRID) * limit / (limit + middle)
    slips = even * middle / (1 - even)
    found = law.at(slips)
    adhesion, slopes = found.adhesion, found.by_parameter
    heights = np.where(np.isfinite(adhesion), adhesion, -np.inf)
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
