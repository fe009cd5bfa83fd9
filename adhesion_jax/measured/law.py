"""A fitted curve with what it misses: adhesion, its errors, and the peak."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from adhesion_jax.curves import Curve
from adhesion_jax.measured.points import Span, misfit_functions
from adhesion_jax.measured.values import values

#: Number of slips among which the largest adhesion is looked for; then three about it, at this
#: share of the distance to its neighbours.
_GRID, _NEARER = 1024, 0.1

#: A peak is not told from rounding where both neighbours, or the last slip, are lower by no more
#: than this share of the largest adhesion: the curve is level there.
_LEVEL = 1e-12


class Law(NamedTuple):
    """f(s; theta) + sum_j b_j (phi_j(s) - df/dtheta lean_j), with the covariance of theta and b."""

    curve: Curve
    parameters: Float[np.ndarray, " free"]
    missed: Float[np.ndarray, " misfits"]  # b
    lean: Float[np.ndarray, "free misfits"]  # what phi has in common with the curve
    covariance: Float[np.ndarray, "all all"]  # zero where held
    span: Span  # of phi
    conditions: Mapping[str, float]


class LawPeak(NamedTuple):
    """The largest adhesion for slips from 0 to a limit, and derivatives by theta and b."""

    slip: float
    adhesion: float
    found: bool  # whether it lies inside that range
    by_law: Float[np.ndarray, " all"]  # of the adhesion
    by_slip: Float[np.ndarray, " all"]  # of the slip


def law_at(
    law: Law, slip: Float[np.ndarray, " points"]
) -> tuple[Float[np.ndarray, " points"], Float[np.ndarray, "points all"]]:
    """Adhesion, and its derivatives by theta and b."""
    found = values(law.curve, law.parameters, slip, law.conditions)
    functions = misfit_functions(slip, law.span) - found.by_parameter @ law.lean
    return found.adhesion + functions @ law.missed, np.hstack([found.by_parameter, functions])


def law_with_errors(
    law: Law, slip: Float[np.ndarray, " points"]
) -> tuple[Float[np.ndarray, " points"], Float[np.ndarray, " points"]]:
    """Adhesion and its standard errors, by the delta method."""
    adhesion, slopes = law_at(law, slip)
    return adhesion, np.sqrt(np.einsum("ni,ij,nj->n", slopes, law.covariance, slopes))


def peak_of(law: Law, limit: float) -> LawPeak:
    """By a grid that is dense where the curve rises, then by parabolas through three points.

    Without a peak within the limit it is the adhesion there, as for a curve that becomes level.
    """
    middle = law.span.middle
    even = np.linspace(0.0, 1.0, _GRID) * limit / (limit + middle)
    slips = even * middle / (1 - even)
    adhesion, slopes = law_at(law, slips)
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
    adhesion, slopes = law_at(law, closer)
    at, weights, tilt = _vertex(closer, adhesion)
    return LawPeak(at, float(weights @ adhesion), True, weights @ slopes, tilt @ slopes)


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
