"""A curve that may bend, fitted to measured rows by weighted robust least squares."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import stdtr, stdtrit

from adhesion_jax.curves import Curve, with_free_values
from adhesion_jax.curves.base import SLIP_VELOCITY_LIMIT
from adhesion_jax.curves.bent import FUNCTIONS
from adhesion_jax.identifiers.base import Status
from adhesion_jax.inference.departure import Departure, departure_of
from adhesion_jax.inference.descent import (
    STRAIGHT,
    Problem,
    chosen_of,
    descended,
    felt,
    from_start,
    parameters_at,
    passed_through,
    posed,
)
from adhesion_jax.inference.law import FittedLaw, LawPeak, peak_of
from adhesion_jax.inference.noise import RunNoise, SlipNoise, described
from adhesion_jax.inference.rows import Rows, in_stretches, thinned
from adhesion_jax.inference.sandwich import Sandwich, sandwich
from adhesion_jax.inference.sums import Sums, Variance, law_at
from adhesion_jax.inference.weighing import EXACT

#: Most rows that tell where the points are.
_ROWS = 20_000

#: Slips at which a law is compared with the nearest curve; and the search of that ends where a step
#: promises to lower half the sum of squares, over the mean square, by less than this.
_COMPARED, _NEAR = 200, 1e-10


class Nearest(NamedTuple):
    """The curve without a departure that is nearest to a law."""

    parameters: Float[np.ndarray, " free"]
    by_law: Float[np.ndarray, "free all"]
    misfit: float
    on_bound: Bool[np.ndarray, " free"]


def nearest_to(
    problem: Problem,
    starts: Sequence[np.ndarray],
    law: FittedLaw,
    free: Bool[np.ndarray, " free"],
    rows: Rows,
    variance: Variance,
) -> Nearest:
    """By least squares from the best of some starts, at slips that share out the rows' weight."""
    some = thinned(rows, _ROWS)
    size = np.abs(some.slip)
    order = np.argsort(size, kind="stable")
    weight = np.cumsum(1 / chosen_of(variance.relative, size.size)[order])
    shares = (np.arange(_COMPARED) + 0.5) / _COMPARED
    slip = size[order[np.searchsorted(weight, shares * weight[-1])]]
    of_law = law.at(slip)
    conditions = {name: np.full(_COMPARED, value) for name, value in law.conditions.items()}
    one, whole = np.ones(_COMPARED), np.array([0, _COMPARED])
    few = Rows(slip, of_law.adhesion, conditions, one, whole, whole, np.zeros(1, int), False, False)
    height = max(float(np.sqrt(np.mean(of_law.adhesion**2))), 1e-300)
    even = Variance(height, one, 0 * one)
    found = []
    for start in starts:
        share, _ = descended(problem, from_start(start), few, even, robust=False, near=_NEAR)
        alone = law._replace(parameters=problem.law(share).parameters).at(slip)
        missed = float(np.sqrt(np.mean((of_law.adhesion - alone.adhesion) ** 2))) / height
        found.append((missed, share, alone))
    missed, share, alone = min(found, key=lambda one: one[0])
    stretch = problem.stretch(share)
    share = share[: problem.free]
    bound = free & ((share <= 0) | (share >= 1))
    used = np.flatnonzero(free & ~bound)
    by_law = np.zeros((problem.free, stretch.size))
    own = alone.by_parameter[:, used] * stretch[used]
    by_law[used] = np.linalg.lstsq(own, of_law.by_parameter, rcond=_NEAR)[0]
    by_law[used] *= stretch[used, None]
    nearest = parameters_at(problem.curve, np.clip(share, 0.0, 1.0))
    return Nearest(nearest, by_law, missed, bound)


#: Parts that are left out to judge a curve, where there are fewer runs.
_PARTS = 12


def left_out(
    found: Sums, rows: Rows, variance: Variance, free: np.ndarray, penalty: np.ndarray
) -> Float[np.ndarray, " parts"]:
    """The log density of each part, given the fit to all others: runs, or a twelfth of a log."""
    parts = rows.cluster
    if rows.clusters < 2:
        parts = np.arange(parts.size) * _PARTS // parts.size
    elif not (rows.ordered or rows.several):  # points in no order: every twelfth
        parts = np.argsort(np.argsort(rows.slip[rows.blocks[:-1]], kind="stable")) % _PARTS
    count, used = int(parts.max()) + 1, np.flatnonzero(free)
    matrix = np.zeros((count, used.size, used.size))
    score, own = np.zeros((count, used.size)), np.zeros(count)
    np.add.at(matrix, parts, found.matrix[:, used[:, None], used])
    np.add.at(score, parts, found.score[:, used])
    spread = np.add.reduceat(np.log(variance.row()), rows.blocks[:-1])
    np.add.at(own, parts, found.squares + spread)
    others = matrix.sum(axis=0) + np.diag(penalty[used]) - matrix
    scale = 1 / np.sqrt(np.maximum(np.diagonal(others, axis1=1, axis2=2), 1e-300))
    even = others * scale[:, :, None] * scale[:, None, :] + 1e-10 * np.eye(used.size)
    step = -scale * np.linalg.solve(even, (scale * score)[:, :, None])[:, :, 0]
    bend = np.einsum("pi,pij,pj->p", step, matrix, step)
    return -0.5 * (own - 2 * np.sum(step * score, axis=1) + bend)


#: Most rows of the search; and those of a longer record are then passed through a few times.
_SEARCH_ROWS = 20_000

#: Rounds of fit, weights and size of the departure.
_ROUNDS = 4

#: About as many rows, in stretches, tell what the noise is.
_NOISE_ROWS = 1_000_000

#: The standard deviation of a normal variable over the median of its size.
_NORMAL = 1.4826


class MeasuredFit(NamedTuple):
    """The fit of one curve with its departure.

    `parameters` are those of the curve that is nearest to the law among the points, as the fit
    weighs them; beside its departure, which may do a part of what they could, the law has others.
    One that is held (on its bound, or without influence) has no standard error (NaN); the others
    have those of a fit with that parameter known.
    """

    law: FittedLaw
    slip_limit: float  # largest slip at which the peak was searched
    slip_unit: str
    points: int
    plain: float  # sum of squares of the residual
    noise: RunNoise
    departure: Departure
    parameters: Float[np.ndarray, " free"]
    by_law: Float[np.ndarray, "free all"]  # derivatives of these by the parameters of the law
    misfit: float  # the law less the nearest curve: root mean square over the points, relative
    sandwich: Sandwich
    stretch: Float[np.ndarray, " all"]  # derivatives of parameters by coordinates of the sandwich
    on_bound: Bool[np.ndarray, " free"]
    no_influence: Bool[np.ndarray, " free"]
    peak: LawPeak
    slip: Float[np.ndarray, " rows"]  # to be expected of each row
    slip_scatter: Float[np.ndarray, " rows"]  # standard deviation of the true slip about that
    slip_spread: Float[np.ndarray, " rows"]  # standard deviation of the noise of the measured slip
    left_out: Float[np.ndarray, " parts"]  # log density of each part, given the others
    converged: bool

    def __repr__(self) -> str:
        peak = f"{float(self.peak.adhesion):.4f} at slip {float(self.peak.slip):.4g}"
        return (
            f"<{type(self.law.curve).__name__} fitted to {self.points} points: largest adhesion "
            f"{peak}{self.slip_unit}, rms {self.rms:.3g}, {self.status.name}>"
        )

    @property
    def curve(self) -> Curve:
        """The nearest curve alone, without a departure."""
        return with_free_values(self.law.curve, self.parameters)

    @property
    def conditions(self) -> Mapping[str, float]:
        return self.law.conditions

    @property
    def held(self) -> Bool[np.ndarray, " free"]:
        return self.on_bound | self.no_influence

    def errors(
        self, directions: Float[np.ndarray, "n all"]
    ) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """Standard errors of linear functions of the parameters, and degrees of freedom."""
        return self.sandwich.errors(directions * self.stretch)

    def at_rows(
        self, rows: Rows, chosen: slice | Int[np.ndarray, " chosen"]
    ) -> tuple[Float[np.ndarray, " chosen"], Float[np.ndarray, " chosen"]]:
        """The law and its slope at these rows, chosen of all, in the mean over the true slips."""
        there = rows._replace(slip=self.slip[chosen])
        mean, slope = law_at(there, self.law, self.slip_scatter[chosen], "by_slip")
        return mean, slope

    def falls(self, slips: Float[np.ndarray, " points"]) -> Float[np.ndarray, " steps"]:
        """The probability that the law is lower at each slip than at the one before it."""
        found = self.law.at(slips)
        errors, degrees = self.errors(np.diff(found.by_parameter, axis=0))
        return stdtr(degrees, -np.diff(found.adhesion) / np.maximum(errors, 1e-300))

    @property
    def standard_errors(self) -> Float[np.ndarray, " free"]:
        return np.where(self.held, np.nan, self.errors(self.by_law)[0])

    @property
    def mu_max_se(self) -> float:
        return float(self.errors(self.peak.by_law[None])[0][0])

    @property
    def slip_opt_se(self) -> float:
        """NaN where there is no peak."""
        return float(self.errors(self.peak.by_slip[None])[0][0]) if self.peak.found else np.nan

    @property
    def degrees(self) -> float:
        """Of freedom of the standard error of the largest adhesion."""
        return float(self.errors(self.peak.by_law[None])[1][0])

    @property
    def rms(self) -> float:
        """sqrt(SSE/n)."""
        return float(np.sqrt(self.plain / self.points))

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval of the largest adhesion by this curve, positive."""
        level = float(self.peak.adhesion)
        half = float(stdtrit(self.degrees, 0.975)) * self.mu_max_se / level
        return level * np.exp(-half), level * np.exp(half)

    @property
    def status(self) -> Status:
        if not np.isfinite(self.plain):
            return Status.NOT_FINITE
        if not self.peak.adhesion > 0:
            return Status.INADMISSIBLE
        if not self.peak.found:
            return Status.NO_PEAK
        if not self.converged or not np.isfinite(self.mu_max_se):
            return Status.NOT_CONVERGED
        return Status.ON_BOX if np.any(self.held) else Status.TRUSTED


def missing_columns(curve: Curve, columns: Mapping[str, object]) -> tuple[str, ...]:
    """The columns without which the curve cannot be evaluated."""
    return tuple(name for name in curve.NEEDS if name not in columns)


def fitted(
    curve: Curve,
    start: Float[np.ndarray, " free"],
    rows: Rows,
    slip: SlipNoise,
    weights: Variance,
    slip_is_velocity: bool,
) -> MeasuredFit:
    """The curve nearest to the rows, within its box, from a near start in shares of the box.

    The sum of Huber's function of the residuals in standard deviations, and the penalty of the
    departure, are lowered by Levenberg and Marquardt's steps; the size of the `weights` and the
    penalty are found anew between rounds. Of a long record evenly chosen rows lead to a place near
    the end, from which all rows are passed through a few times.
    """
    problem, limit = posed(curve, start, rows, slip_is_velocity)
    some = thinned(rows, _SEARCH_ROWS)
    share, reached, departure = from_start(start), False, STRAIGHT
    variance = weights
    if some is not rows:
        relative, spread = (chosen_of(column, some.slip.size) for column in weights[1:])
        variance = Variance(weights.sigma, relative, spread)
    for turn in range(2 + _ROUNDS):
        left = _left(problem, share, some, variance)
        variance = _scaled(problem, left, some, departure, variance)
        if turn >= 2:
            found = problem.sums(share, some, variance)
            departure = _departure(problem, share, found, some, variance)
        share, reached = descended(problem, share, some, variance, departure, turn > 0)
    left = _left(problem, share, some, variance)
    variance = _scaled(problem, left, some, departure, variance)
    if some is not rows:
        found = problem.sums(share, rows, weights._replace(sigma=variance.sigma))
        variance = _scaled(problem, found.residual, rows, departure, weights)
        departure = _departure(problem, share, found, rows, variance)
        share, reached = passed_through(problem, share, found.residual, rows, variance, departure)
        del found
    fit = _described(problem, start, share, rows, slip, variance, departure, limit)
    return fit._replace(converged=reached)


def _left(problem: Problem, share: np.ndarray, rows: Rows, variance: Variance) -> np.ndarray:
    (law,) = law_at(rows, problem.law(share), variance.spread)
    return rows.adhesion - law


def _scaled(
    problem: Problem, left: np.ndarray, rows: Rows, departure: Departure, weights: Variance
) -> Variance:
    """The weights with the size that the residual has, robust, less what the fit takes of it."""
    count = left.size
    degrees = count / max(count - problem.free - departure.degrees, 0.25 * count)
    size = np.abs(left)
    size /= np.sqrt(weights.relative)
    size /= weights.sigma
    floor = EXACT * float(np.sqrt(rows.adhesion @ rows.adhesion / count)) / weights.sigma
    least = 0.1 * np.sqrt(degrees * float(size @ size) / count)
    middle = np.sqrt(degrees) * float(np.median(size, overwrite_input=True))
    own = max(_NORMAL * middle, least, floor)
    return weights._replace(sigma=weights.sigma * own)


def _departure(
    problem: Problem, share: np.ndarray, found: Sums, rows: Rows, variance: Variance
) -> Departure:
    free = felt(found, rows.slip.size, variance) & (share > 0) & (share < 1)
    free[problem.free :] = True
    ordered = rows.ordered or rows.several
    return departure_of(found, share[problem.free :], free, rows.cluster, ordered)


def _noise(law: FittedLaw, rows: Rows, variance: Variance, slip: SlipNoise) -> RunNoise:
    some, chosen = in_stretches(rows, _NOISE_ROWS)
    spread = variance.spread[chosen]
    mean, slope = law_at(some, law, spread, "by_slip")
    within = Variance(variance.sigma, variance.relative[chosen], spread)
    return described(some, some.adhesion - mean, slope, mean, within, slip)


def _described(
    problem: Problem,
    start: np.ndarray,
    share: np.ndarray,
    rows: Rows,
    slip: SlipNoise,
    variance: Variance,
    departure: Departure,
    limit: float,
) -> MeasuredFit:
    count = problem.free
    found = problem.sums(share, rows, variance)
    has_influence = felt(found, rows.slip.size, variance)[:count]
    bound = has_influence & ((share[:count] <= 0) | (share[:count] >= 1))
    free = np.append(has_influence & ~bound, np.ones(FUNCTIONS, dtype=bool))
    penalty = np.append(np.zeros(count), departure.penalty)
    ordered = rows.ordered or rows.several
    covariance = sandwich(found, rows.cluster, free, penalty, departure.inflation, ordered)
    law = problem.law(share)
    nearest = nearest_to(problem, [share[:count], start], law, has_influence, rows, variance)
    return MeasuredFit(
        law,
        limit,
        " m/s" if limit == SLIP_VELOCITY_LIMIT else "",
        rows.slip.size,
        float(found.residual @ found.residual),
        _noise(law, rows, variance, slip),
        departure,
        nearest.parameters,
        nearest.by_law,
        nearest.misfit,
        covariance,
        problem.stretch(share),
        nearest.on_bound,
        ~has_influence,
        peak_of(law, limit),
        rows.slip,
        variance.spread,
        slip.spread,
        left_out(found, rows, variance, free, penalty),
        True,
    )
