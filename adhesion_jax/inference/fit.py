"""A curve that may bend, fitted to measured rows by weighted robust least squares."""

from collections.abc import Mapping
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Bool, Float
from scipy.special import stdtrit

from adhesion_jax.curves import SLIP_LIMIT, Curve, with_free_values
from adhesion_jax.curves.bent import FUNCTIONS
from adhesion_jax.identifiers.base import Status
from adhesion_jax.inference.departure import Departure, departure_of
from adhesion_jax.inference.law import FittedLaw, LawPeak, peak_of
from adhesion_jax.inference.noise import RunNoise, described
from adhesion_jax.inference.rows import Rows, thinned
from adhesion_jax.inference.sandwich import Sandwich, sandwich
from adhesion_jax.inference.slip import SlipNoise
from adhesion_jax.inference.start import parameters_at, stretch_at
from adhesion_jax.inference.sums import Sums, Variance, residuals, sums
from adhesion_jax.inference.values import Span
from adhesion_jax.optim.levenberg_marquardt import Local, advanced, arrived, begin

#: Largest slip at which a peak is searched if slip is a velocity, m/s.
SLIP_VELOCITY_LIMIT = 10.0

#: Most rows of the search; and those of a longer record are then passed through a few times.
_SEARCH_ROWS = 20_000

#: Rounds of fit, weights and size of the departure; most evaluations of the fit in one.
_ROUNDS, _MOST_STEPS = 4, 40

#: A fit has arrived where a step promises to lower half the deviance by less than this.
_NEAR = 1e-4

#: The program of a step serves parameters up to a multiple of this number.
_WIDTH = 16

#: Largest factor of a departure.
_MOST_DEPARTURE = 1.0

#: A parameter has no influence if its whole range changes adhesion by less than this (rms).
_NO_INFLUENCE = 1e-7

#: A residual below this share of the adhesion is due to the rounding of numbers, not to noise.
EXACT = 1e-10

#: Share of the largest slip about which a departure is finest, for a curve without a peak; and the
#: share of the slip of the peak below which its functions are straight.
_MIDDLE, _REACH = 0.2, 0.2

#: Groups of rows of like slope whose scatter tells how much of the slip's noise acts.
_GROUPS = 8

#: Multiple of its noise below which a slip says nothing of the curve; the variance of its row over
#: the mean square of adhesion, and over that of others beyond which a row is such a one.
_TOLD, _SILENT, _NEVER = 3.0, 1e6, 1e6

#: The standard deviation of a normal variable over the median of its size.
_NORMAL = 1.4826

#: Parts that are left out to judge a curve, where there are fewer runs.
_PARTS = 12


#: No departure at all.
STRAIGHT = Departure(0.0, np.full(FUNCTIONS, np.inf), 1.0, 0.0, 0.0)


class MeasuredFit(NamedTuple):
    """The fit of one curve with its departure.

    A parameter that is held (on its bound, or without influence) has no standard error (NaN); the
    others have those of a fit with that parameter known.
    """

    law: FittedLaw
    slip_limit: float  # largest slip at which the peak was searched
    slip_unit: str
    points: int
    plain: float  # sum of squares of the residual
    noise: RunNoise
    departure: Departure
    misfit: float  # the departure: its root mean square over the points
    sandwich: Sandwich
    stretch: Float[np.ndarray, " all"]  # derivatives of parameters by coordinates of the sandwich
    on_bound: Bool[np.ndarray, " free"]
    no_influence: Bool[np.ndarray, " free"]
    peak: LawPeak
    slip_spread: Float[np.ndarray, " rows"]  # standard deviation of the slip that acts
    left_out: Float[np.ndarray, " parts"]  # log density of each part, given the others
    converged: bool

    @property
    def curve(self) -> Curve:
        """The curve alone, with the fitted values of its free parameters."""
        return with_free_values(self.law.curve, self.parameters)

    @property
    def conditions(self) -> Mapping[str, float]:
        return self.law.conditions

    @property
    def parameters(self) -> Float[np.ndarray, " free"]:
        return self.law.parameters[: len(self.law.curve.free)]

    @property
    def held(self) -> Bool[np.ndarray, " free"]:
        return self.on_bound | self.no_influence

    def errors(
        self, directions: Float[np.ndarray, "n all"]
    ) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """Standard errors of linear functions of the parameters, and degrees of freedom."""
        return self.sandwich.errors(directions * self.stretch)

    @property
    def standard_errors(self) -> Float[np.ndarray, " free"]:
        free = np.eye(self.stretch.size)[: self.parameters.size]
        return np.where(self.held, np.nan, self.errors(free)[0])

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
    def log_density(self) -> float:
        """Of all parts, each given the others: the larger, the better the curve predicts them."""
        return float(np.sum(self.left_out))

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


class _Place(NamedTuple):
    """Coordinates of a fit, shares of the box and factors, and where it ended."""

    share: Float[np.ndarray, " all"]
    converged: bool


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
    problem, conditions, limit = _posed(curve, start, rows, slip_is_velocity)
    some = thinned(rows, _SEARCH_ROWS)
    place = _Place(np.append(np.clip(start, 0.0, 1.0), np.zeros(FUNCTIONS)), False)
    variance, departure = _thinned(weights, rows, some), STRAIGHT
    for turn in range(2):
        variance = _scaled(problem, place.share, some, departure, variance)
        place = _descended(problem, place.share, some, variance, STRAIGHT, turn > 0)
    for _ in range(_ROUNDS):
        variance = _scaled(problem, place.share, some, departure, variance)
        departure = _departure(problem, place.share, some, variance)
        place = _descended(problem, place.share, some, variance, departure, True)
    variance = _scaled(problem, place.share, rows, departure, weights)
    if some is not rows:
        departure = _departure(problem, place.share, rows, variance)
        place = _descended(problem, place.share, rows, variance, departure, True)
    return _described(problem, place, rows, slip, variance, departure, conditions, limit)


def alike(rows: Rows) -> Variance:
    """The variance of rows whose slip is exact, in any unit."""
    return Variance(1.0, 1 / rows.design, np.broadcast_to(0.0, rows.slip.shape))


def weighed(
    curve: Curve,
    start: Float[np.ndarray, " free"],
    rows: Rows,
    slip: SlipNoise,
    slip_is_velocity: bool,
) -> Variance:
    """The variance of rows of noisy slip, by the slope of one curve without a departure.

    It is the same for all curves that are fitted: with a slope of its own a curve could widen its
    own noise (Carroll and Ruppert 1988, chapter 3).
    """
    problem, _, _ = _posed(curve, start, rows, slip_is_velocity)
    some = thinned(rows, _SEARCH_ROWS)
    noise = slip._replace(spread=_chosen(slip.spread, some.slip.size))
    share = np.append(np.clip(start, 0.0, 1.0), np.zeros(FUNCTIONS))
    for turn in range(_ROUNDS):
        variance = _variance(problem, share, some, noise)
        share = _descended(problem, share, some, variance, STRAIGHT, turn > 0).share
    return _variance(problem, share, rows, slip)


def _posed(
    curve: Curve, start: np.ndarray, rows: Rows, slip_is_velocity: bool
) -> tuple["_Problem", Mapping[str, float], float]:
    """The problem, the conditions of its peak, and the largest slip of that."""
    limit = SLIP_VELOCITY_LIMIT if slip_is_velocity else SLIP_LIMIT
    conditions = {name: float(np.median(rows.conditions[name])) for name in curve.NEEDS}
    largest = float(max(rows.slip.max(), -rows.slip.min(), np.finfo(float).tiny))
    return _Problem(curve, _span(curve, start, conditions, limit, largest)), conditions, limit


def _chosen(column: np.ndarray, count: int) -> np.ndarray:
    return column[np.linspace(0, column.size - 1, count).astype(int)]


def _thinned(weights: Variance, rows: Rows, some: Rows) -> Variance:
    if some is rows:
        return weights
    count = some.slip.size
    return Variance(weights.sigma, _chosen(weights.row, count), _chosen(weights.spread, count))


class _Problem(NamedTuple):
    """A curve and where its departure lives."""

    curve: Curve
    span: Span

    @property
    def free(self) -> int:
        return len(self.curve.free)

    def parameters(self, share: np.ndarray) -> np.ndarray:
        return np.append(parameters_at(self.curve, share[: self.free]), share[self.free :])

    def stretch(self, share: np.ndarray) -> np.ndarray:
        own = stretch_at(self.curve, share[: self.free])
        return np.append(own, np.ones(FUNCTIONS))

    def sums(
        self, share: np.ndarray, rows: Rows, variance: Variance, robust: bool, searching: bool
    ) -> Sums:
        place = self.parameters(share), self.stretch(share)
        return sums(rows, self.curve, *place, self.span, variance, robust, searching)


def _span(
    curve: Curve, start: np.ndarray, conditions: Mapping[str, float], limit: float, largest: float
) -> Span:
    """Finest about the peak of the curve of least squares, if that lies among the points."""
    usual = Span(_REACH * _MIDDLE * largest, largest)
    parameters = np.append(parameters_at(curve, start), np.zeros(FUNCTIONS))
    peak = peak_of(FittedLaw(curve, parameters, usual, conditions), limit)
    middle = peak.slip if peak.found and 0 < peak.slip < largest else _MIDDLE * largest
    return Span(_REACH * middle, largest)


def _scaled(
    problem: _Problem, share: np.ndarray, rows: Rows, departure: Departure, weights: Variance
) -> Variance:
    """The weights with the size that the residual has, robust, less what the fit takes of it."""
    parameters = problem.parameters(share)
    left, _, _ = residuals(rows, problem.curve, parameters, problem.span, weights.spread)
    telling = weights.row < _NEVER * weights.sigma**2
    count = int(telling.sum())
    degrees = count / max(count - problem.free - departure.degrees, 0.25 * count)
    size = np.sqrt(degrees) * np.abs(left[telling]) / np.sqrt(weights.row[telling])
    floor = EXACT * float(np.sqrt(np.mean(rows.adhesion**2))) / weights.sigma
    own = max(_NORMAL * float(np.median(size)), 0.1 * float(np.sqrt(np.mean(size**2))), floor)
    return Variance(weights.sigma * own, weights.row * own**2, weights.spread)


def _variance(problem: _Problem, share: np.ndarray, rows: Rows, slip: SlipNoise) -> Variance:
    """Of every row, from the residual: sigma, and how much of the slip's noise acts.

    Rows of like slope x spread make groups; their robust variances are sigma^2 + share^2 (slope x
    spread)^2 by non-negative least squares. The share is at most 1, and 1 for a noise that is
    given. Rows whose slip is below three standard deviations of its noise say nothing of any curve,
    and count for nothing.
    """
    parameters = problem.parameters(share)
    left, slope, _ = residuals(rows, problem.curve, parameters, problem.span, slip.spread)
    size = np.abs(left) * np.sqrt(rows.design)
    floor = EXACT * float(np.sqrt(np.mean(rows.adhesion**2)))
    felt = np.abs(slope) * slip.spread
    groups = np.array_split(np.argsort(felt, kind="stable"), _GROUPS)
    scatter = np.array([max(_NORMAL * float(np.median(size[g])), floor) ** 2 for g in groups])
    from_slip = np.array([float(np.mean(felt[g] ** 2)) for g in groups])
    if slip.given:
        own = float(np.median(np.maximum(scatter - from_slip, 0.01 * scatter)))
        active = 1.0
    else:
        design = np.column_stack([np.ones(_GROUPS), from_slip]) / scatter[:, None]
        (own, active), _ = scipy.optimize.nnls(design, np.ones(_GROUPS))
    own = max(own, 1e-3 * float(scatter.min()), floor**2)
    spread = np.sqrt(min(active, 1.0)) * slip.spread
    row = own / rows.design + (slope * spread) ** 2
    silent = np.abs(rows.slip) < _TOLD * spread
    row = np.where(silent & (not silent.all()), _SILENT * np.mean(rows.adhesion**2), row)
    return Variance(float(np.sqrt(own)), row, spread)


def _departure(problem: _Problem, share: np.ndarray, rows: Rows, variance: Variance) -> Departure:
    found = problem.sums(share, rows, variance, True, False)
    free = _felt(found, rows.slip.size, variance) & (share > 0) & (share < 1)
    free[problem.free :] = True
    ordered = rows.ordered or rows.several
    return departure_of(found, share[problem.free :], free, rows.cluster, ordered)


def _felt(found: Sums, points: int, variance: Variance) -> np.ndarray:
    squares = np.diagonal(found.matrix.sum(axis=0))
    return np.sqrt(squares / points) * variance.sigma >= _NO_INFLUENCE


def _descended(
    problem: _Problem,
    share: np.ndarray,
    rows: Rows,
    variance: Variance,
    departure: Departure,
    robust: bool,
) -> _Place:
    """The least penalised sum, by the package's Levenberg-Marquardt."""
    width = -(-share.size // _WIDTH) * _WIDTH
    empty = np.zeros(width - share.size)
    penalty = np.where(np.isfinite(departure.penalty), departure.penalty, 0.0)
    held = ~np.isfinite(departure.penalty)
    bound = np.where(held, 0.0, _MOST_DEPARTURE)
    lower = np.concatenate([np.zeros(problem.free), -bound, empty])
    upper = np.concatenate([np.ones(problem.free), bound, empty])

    def local_at(place: np.ndarray) -> Local:
        found = problem.sums(place, rows, variance, robust, True)
        factors = place[problem.free :]
        loss = found.loss[0] + 0.5 * float(penalty @ factors**2)
        gradient, hessian = np.zeros(width), np.zeros((width, width))
        gradient[: share.size] = -found.score[0]
        gradient[problem.free : share.size] += penalty * factors
        hessian[: share.size, : share.size] = found.matrix[0]
        diagonal = np.arange(problem.free, share.size)
        hessian[diagonal, diagonal] += penalty
        loss = loss if np.isfinite(loss) else np.inf
        return Local(jnp.asarray(loss), jnp.asarray(gradient), jnp.asarray(hessian))

    search = begin(jnp.append(share, empty))
    converged = False
    for _ in range(_MOST_STEPS):
        local = local_at(np.asarray(search.trial)[: share.size])
        near = jnp.asarray(_NEAR / max(float(local.loss), 1e-300))
        search = advanced(search, local, lower, upper, near)
        converged = bool(arrived(search, near))
        if converged:
            break
    return _Place(np.asarray(search.x)[: share.size], converged)


def _described(
    problem: _Problem,
    place: _Place,
    rows: Rows,
    slip: SlipNoise,
    variance: Variance,
    departure: Departure,
    conditions: Mapping[str, float],
    limit: float,
) -> MeasuredFit:
    share, count = place.share, problem.free
    found = problem.sums(share, rows, variance, True, False)
    felt = _felt(found, rows.slip.size, variance)[:count]
    bound = felt & ((share[:count] <= 0) | (share[:count] >= 1))
    free = np.append(felt & ~bound, np.ones(FUNCTIONS, dtype=bool))
    penalty = np.append(np.zeros(count), departure.penalty)
    ordered = rows.ordered or rows.several
    covariance = sandwich(found, rows.cluster, free, penalty, departure.inflation, ordered)
    law = FittedLaw(problem.curve, problem.parameters(share), problem.span, conditions)
    left, slope, mean = residuals(
        rows, problem.curve, law.parameters, problem.span, variance.spread
    )
    bare = FittedLaw(
        problem.curve,
        np.append(law.parameters[:count], np.zeros(FUNCTIONS)),
        problem.span,
        conditions,
    )
    grid = np.quantile(np.abs(thinned(rows, _SEARCH_ROWS).slip), np.linspace(0, 1, 200))
    missed = law.at(grid).adhesion - bare.at(grid).adhesion
    return MeasuredFit(
        law,
        limit,
        " m/s" if limit == SLIP_VELOCITY_LIMIT else "",
        rows.slip.size,
        found.plain,
        described(rows, left, slope, mean, variance, slip),
        departure,
        float(np.sqrt(np.mean(missed**2) / max(np.mean(bare.at(grid).adhesion ** 2), 1e-300))),
        covariance,
        problem.stretch(share),
        bound,
        ~felt,
        peak_of(law, limit),
        variance.spread,
        _left_out(found, rows, variance, free, penalty),
        place.converged,
    )


def _left_out(
    found: Sums,
    rows: Rows,
    variance: Variance,
    free: np.ndarray,
    penalty: np.ndarray,
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
    spread = np.add.reduceat(np.log(variance.row), rows.blocks[:-1])
    np.add.at(own, parts, found.squares + spread)
    others = matrix.sum(axis=0) + np.diag(penalty[used]) - matrix
    scale = 1 / np.sqrt(np.maximum(np.diagonal(others, axis1=1, axis2=2), 1e-300))
    even = others * scale[:, :, None] * scale[:, None, :] + 1e-10 * np.eye(used.size)
    step = -scale * np.linalg.solve(even, (scale * score)[:, :, None])[:, :, 0]
    bend = np.einsum("pi,pij,pj->p", step, matrix, step)
    return -0.5 * (own - 2 * np.sum(step * score, axis=1) + bend)
