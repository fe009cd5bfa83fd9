"""The least penalised sum of Huber's function of the residuals, by Levenberg and Marquardt."""

from collections.abc import Mapping
from functools import cache
from types import MappingProxyType
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from adhesion_jax.curves import SLIP_LIMIT, Curve
from adhesion_jax.curves.base import SLIP_VELOCITY_LIMIT
from adhesion_jax.curves.bent import FUNCTIONS
from adhesion_jax.inference.departure import Departure
from adhesion_jax.inference.law import FittedLaw, Span, peak_of
from adhesion_jax.inference.rows import Rows, evenly, means, of_like
from adhesion_jax.inference.sums import Sums, Variance, law_at, pull, sums
from adhesion_jax.optim.levenberg_marquardt import Local, Search, advanced, arrived, begin


def _box(curve: Curve) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lower bounds; ratios of logarithmic scales, 1 for the others; widths of these, or 0."""
    described = [curve.PARAMETERS[name] for name in curve.free]
    lower, upper = np.array([[p.lower, p.upper] for p in described]).T
    logarithmic = lower > 0
    ratio = np.where(logarithmic, upper, 1.0) / np.where(logarithmic, lower, 1.0)
    return lower, ratio, np.where(logarithmic, 0.0, upper - lower)


def parameters_at(curve: Curve, share: Any) -> Any:
    """The parameters at shares of the physical box, [free], of NumPy or of jax."""
    lower, ratio, width = _box(curve)
    return lower * ratio**share + width * share


def stretch_at(curve: Curve, share: Float[np.ndarray, " free"]) -> Float[np.ndarray, " free"]:
    """The derivatives of the parameters by the shares of the box."""
    lower, ratio, width = _box(curve)
    return lower * ratio**share * np.log(ratio) + width


#: Most evaluations of a descent.
_MOST_STEPS = 40

#: A fit has arrived where a step promises to lower half the deviance by less than this.
_NEAR = 1e-4

#: The program of a step serves parameters up to a multiple of this number.
_WIDTH = 16

#: Largest factor of a departure.
_MOST_DEPARTURE = 1.0

#: A parameter has no influence if its whole range changes adhesion by less than this (rms).
_NO_INFLUENCE = 1e-7

#: Times that all rows of a long record are passed through; groups of them by slip, or by slip and
#: the first condition of a curve; most evaluations of the means of these.
_PASSES, _GROUPS, _MOST_OF_FEW = 2, (2700, (400, 50)), 400

#: Rows that are weighed at a time, so that no further copies of all are held.
_AT_A_TIME = 100_000

#: No departure at all.
STRAIGHT = Departure(0.0, np.full(FUNCTIONS, np.inf), 1.0, 0.0, 0.0)


class Problem(NamedTuple):
    """A curve and where its departure lives; coordinates are shares of the box, then factors.

    The conditions are those of the peak.
    """

    curve: Curve
    span: Span
    conditions: Mapping[str, float] = MappingProxyType({})

    @property
    def free(self) -> int:
        return len(self.curve.free)

    def law(self, share: Float[np.ndarray, " all"]) -> FittedLaw:
        parameters = np.append(parameters_at(self.curve, share[: self.free]), share[self.free :])
        return FittedLaw(self.curve, parameters, self.span, self.conditions)

    def stretch(self, share: Float[np.ndarray, " all"]) -> Float[np.ndarray, " all"]:
        """The derivatives of the parameters by the coordinates."""
        return np.append(stretch_at(self.curve, share[: self.free]), np.ones(FUNCTIONS))

    def sums(
        self,
        share: Float[np.ndarray, " all"],
        rows: Rows,
        variance: Variance,
        robust: bool = True,
        blocks: Int[np.ndarray, " edges"] | None = None,
    ) -> Sums:
        """Over the blocks of the rows, unless others are given."""
        edges = rows.blocks if blocks is None else blocks
        return sums(rows, self.law(share), self.stretch(share), variance, robust, edges)


def felt(found: Sums, points: int, variance: Variance) -> Bool[np.ndarray, " all"]:
    """Which parameters have an influence."""
    squares = np.diagonal(found.matrix.sum(axis=0))
    return np.sqrt(squares / points) * variance.sigma >= _NO_INFLUENCE


@cache
def _begun(width: int) -> Search:
    """A search before its first evaluation."""
    return begin(jnp.zeros(width))


def descended(
    problem: Problem,
    share: Float[np.ndarray, " all"],
    rows: Rows,
    variance: Variance,
    departure: Departure = STRAIGHT,
    robust: bool = True,
    near: float = _NEAR,
    most: int = _MOST_STEPS,
) -> tuple[Float[np.ndarray, " all"], bool]:
    """The place of the least sum, with the penalty of the departure, and whether it was reached."""
    width = -(-share.size // _WIDTH) * _WIDTH
    empty = np.zeros(width - share.size)
    whole = np.array([0, rows.slip.size])
    held = ~np.isfinite(departure.penalty)
    penalty = np.where(held, 0.0, departure.penalty)
    bound = np.where(held, 0.0, _MOST_DEPARTURE)
    lower = np.concatenate([np.zeros(problem.free), -bound, empty])
    upper = np.concatenate([np.ones(problem.free), bound, empty])

    def local_at(place: np.ndarray) -> Local:
        found = problem.sums(place, rows, variance, robust, whole)
        factors = place[problem.free :]
        loss = found.loss[0] + 0.5 * float(penalty @ factors**2)
        gradient: Any = np.zeros(width)
        hessian: Any = np.zeros((width, width))
        gradient[: share.size] = -found.score[0]
        gradient[problem.free : share.size] += penalty * factors
        hessian[: share.size, : share.size] = found.pulled
        diagonal = np.arange(problem.free, share.size)
        hessian[diagonal, diagonal] += penalty
        finite: Any = np.asarray(loss if np.isfinite(loss) else np.inf)
        return Local(finite, gradient, hessian)

    start, converged = jnp.append(share, empty), False
    search = _begun(width)._replace(x=start, trial=start)
    for _ in range(most):
        local = local_at(np.asarray(search.trial)[: share.size])
        enough = jnp.asarray(near / max(float(local.loss), 1e-300))
        search = advanced(search, local, lower, upper, enough)
        converged = bool(arrived(search, enough))
        if converged:
            break
    return np.asarray(search.x)[: share.size], converged


def passed_through(
    problem: Problem,
    share: Float[np.ndarray, " all"],
    residual: Float[np.ndarray, " rows"],
    rows: Rows,
    variance: Variance,
    departure: Departure,
) -> tuple[Float[np.ndarray, " all"], bool]:
    """As `descended`, for many rows, from a near place with this residual, which is overwritten.

    Huber's weights at a place make all rows those of least squares, for which the weighted means of
    groups of like rows stand; their least sum is the next place (Holland and Welsch 1977, Commun.
    Stat. A 6:813-827).
    """
    needed = {name: rows.conditions[name] for name in problem.curve.NEEDS}
    group = of_like(rows.slip, needed, *_GROUPS)
    reached = False
    for turn in range(_PASSES):
        if turn:
            (law,) = law_at(rows, problem.law(share), variance.spread)
            np.subtract(rows.adhesion, law, out=residual)
            del law
        for first in range(0, residual.size, _AT_A_TIME):
            some = slice(first, first + _AT_A_TIME)
            row = variance.row(some)
            residual[some] = pull(residual[some] / np.sqrt(row)) / row
        found = means(group, residual, rows.slip, rows.adhesion, needed, variance.spread)
        one, whole = np.ones(found.slip.size), np.array([0, found.slip.size])
        few = rows._replace(
            slip=found.slip,
            adhesion=found.adhesion,
            conditions=found.conditions,
            design=one,
            blocks=whole,
        )
        alike = Variance(1.0, 1 / found.weight, np.sqrt(found.square))
        share, reached = descended(problem, share, few, alike, departure, False, most=_MOST_OF_FEW)
    return share, reached


#: Share of the largest slip about which a departure is finest, for a curve without a peak; and the
#: share of the slip of the peak below which its functions are straight.
_MIDDLE, _REACH = 0.2, 0.2


def posed(
    curve: Curve, start: np.ndarray, rows: Rows, slip_is_velocity: bool
) -> tuple[Problem, float]:
    """The problem, and the largest slip at which its peak is sought."""
    limit = SLIP_VELOCITY_LIMIT if slip_is_velocity else SLIP_LIMIT
    conditions = {name: float(np.median(rows.conditions[name])) for name in curve.NEEDS}
    largest = float(max(rows.slip.max(), -rows.slip.min(), np.finfo(float).tiny))
    # Finest about the peak of the curve of least squares, if that lies among the points.
    usual = Problem(curve, Span(_REACH * _MIDDLE * largest, largest), conditions)
    peak = peak_of(usual.law(np.append(start, np.zeros(FUNCTIONS))), limit)
    middle = peak.slip if peak.found and 0 < peak.slip < largest else _MIDDLE * largest
    return usual._replace(span=Span(_REACH * middle, largest)), limit


def from_start(start: np.ndarray) -> np.ndarray:
    return np.append(np.clip(start, 0.0, 1.0), np.zeros(FUNCTIONS))


def chosen_of(column: np.ndarray, count: int) -> np.ndarray:
    return column[evenly(column.size, count)]
