"""A curve fitted to a measured record under the noise of its runs, and its peak with errors."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import stdtrit

from adhesion_jax.curves import SLIP_LIMIT, Curve, with_free_values
from adhesion_jax.identifiers.base import Status
from adhesion_jax.measured.law import Law, LawPeak, peak_of
from adhesion_jax.measured.noise import (
    MISFITS,
    ROUNDING,
    Allowed,
    Products,
    RunNoise,
    estimated,
    inverse,
    left_out,
    normal_equations,
    solve,
    whitened,
)
from adhesion_jax.measured.points import Points, Span, products, weights
from adhesion_jax.measured.start import parameters_at, stretch_at
from adhesion_jax.optim.levenberg_marquardt import damped_step

#: Largest slip at which a peak is searched if slip is a velocity, m/s.
SLIP_VELOCITY_LIMIT = 10.0

#: Largest number of evaluations of the curve at all points.
_MOST_STEPS = 30

#: A fit has converged after a step that promises to lower half the deviance by less than this: of
#: less than a twentieth of a standard error.
_NEAR = 1e-3

#: The noise is estimated anew after steps that promise more than this.
_FAR = 1e-2

#: A step may raise the deviance by this: the level that the scatter of the runs multiplies is
#: taken as known in a step, and changes a little with it.
_TOLERATED = 1e-3

#: Turns in which the weights of points of noisy slip are found. They follow from the slope of the
#: start and are then kept: with its own slope a curve could widen its own noise (variance function
#: by a preliminary estimate: Carroll and Ruppert 1988, chapter 3).
_WEIGHTINGS = 2

#: A parameter has no influence if its whole range changes adhesion by less than this (rms).
_NO_INFLUENCE = 1e-7

#: A residual below this share of the adhesion is due to the rounding of numbers, not to noise.
EXACT = 1e-10

#: Share of the largest slip at which the functions of the misfit are densest, without a peak.
_MIDDLE = 0.2


class MeasuredFit(NamedTuple):
    """The fit of one curve under the noise of greatest restricted likelihood; see `noise`.

    The law is the curve with what it misses. A parameter that is held (on its bound, or without
    influence) has no standard error (NaN); the others have those of a fit with that parameter
    known.
    """

    curve: Curve  # with the fitted values of its free parameters
    conditions: Mapping[str, float]  # conditions of the peak: the medians of the record
    slip_limit: float  # largest slip at which the peak was searched
    slip_unit: str
    points: int
    sum_of_squares: float  # of the residual of the curve
    noise: RunNoise
    misfit: float  # what the curve misses: its root mean square over the points, relative
    law: Law
    on_bound: Bool[np.ndarray, " free"]
    no_influence: Bool[np.ndarray, " free"]
    peak: LawPeak
    slip_opt_se: float  # NaN where there is no peak
    mu_max_se: float
    degrees: float  # of freedom of the standard errors
    effective: float  # independent points without scatter or misfit that would tell as much
    left_out: Float[np.ndarray, " parts"]  # log density of each part, given the others
    products: Products
    converged: bool

    @property
    def parameters(self) -> Float[np.ndarray, " free"]:
        return self.law.parameters

    @property
    def covariance(self) -> Float[np.ndarray, "free free"]:
        """Of the parameters; zero where held."""
        count = self.parameters.size
        return self.law.covariance[:count, :count]

    @property
    def held(self) -> Bool[np.ndarray, " free"]:
        return self.on_bound | self.no_influence

    @property
    def standard_errors(self) -> Float[np.ndarray, " free"]:
        return np.where(self.held, np.nan, np.sqrt(np.diagonal(self.covariance)))

    @property
    def run_scatter(self) -> float:
        """Standard deviation of the levels of the runs, relative."""
        return self.noise.sigma * float(np.sqrt(self.noise.scatter))

    @property
    def rms(self) -> float:
        """sqrt(SSE/n)."""
        return float(np.sqrt(self.sum_of_squares / self.points))

    @property
    def bic(self) -> float:
        """Bayes' information criterion for independent points: n ln(SSE/n) + (p + 1) ln n.

        p counts all free parameters, held or not, and the one more is the noise variance.
        Schwarz 1978, Ann. Statist. 6:461-464, less the constants that all curves share.
        """
        size = self.parameters.size + 1
        return float(
            2 * self.points * np.log(max(self.rms, np.finfo(float).tiny))
            + size * np.log(self.points)
        )

    @property
    def log_density(self) -> float:
        """Of all parts, each given the others: the larger, the better the curve predicts them."""
        return float(np.sum(self.left_out))

    @property
    def quantile(self) -> float:
        """Half the width of a 95 % interval in standard errors."""
        return float(stdtrit(self.degrees, 0.975))

    @property
    def status(self) -> Status:
        if not np.isfinite(self.sum_of_squares):
            return Status.NOT_FINITE
        if not self.peak.adhesion > 0:
            return Status.INADMISSIBLE
        if not self.peak.found:
            return Status.NO_PEAK
        if not self.converged or not np.all(np.isfinite(self.covariance)):
            return Status.NOT_CONVERGED
        return Status.ON_BOX if np.any(self.held) else Status.TRUSTED


def missing_columns(curve: Curve, columns: Mapping[str, object]) -> tuple[str, ...]:
    """The columns without which the curve cannot be evaluated."""
    return tuple(name for name in curve.NEEDS if name not in columns)


class _State(NamedTuple):
    """The sums of products at a place."""

    share: Float[np.ndarray, " free"]
    products: Products
    squares: float


def fitted(
    curve: Curve, start: Float[np.ndarray, " free"], points: Points, slip_is_velocity: bool
) -> MeasuredFit:
    """The curve nearest to the points under their noise, within its box, from a near start.

    `start` and the steps are in shares of the box. Levenberg and Marquardt's steps, the noise
    estimated anew after each.
    """
    limit = SLIP_VELOCITY_LIMIT if slip_is_velocity else SLIP_LIMIT
    medians = {name: float(np.median(points.conditions[name])) for name in curve.NEEDS}
    largest = float(max(points.slip.max(), -points.slip.min(), np.finfo(float).tiny))
    span = _span(curve, parameters_at(curve, start), medians, limit, largest)
    floor = (EXACT * float(np.sqrt(np.mean(points.adhesion**2)))) ** 2

    weight = np.broadcast_to(1.0, points.slip.shape)

    def at(share: np.ndarray) -> _State:
        there, stretch = parameters_at(curve, share), stretch_at(curve, share)
        return _State(share, *products(points, curve, there, stretch, span, weight))

    state = at(start)
    felt = _felt(state.products)

    def noise_at(state: _State, near: RunNoise | None) -> RunNoise:
        free = felt & (state.share > 0) & (state.share < 1)
        allowed = Allowed(free, points.ordered, points.several)
        return estimated(state.products, allowed, floor, near)

    noise = noise_at(state, None)
    for _ in range(_WEIGHTINGS if points.slip_noise.any() else 0):
        weight = weights(points, curve, parameters_at(curve, start), noise.sigma)
        state = at(start)
        noise = noise_at(state, None)
    damping, converged = 1e-3, False
    for _ in range(_MOST_STEPS):
        share, promised = _step(state, noise, felt, 0.0)
        converged = promised < _NEAR
        if not converged:
            share, _ = _step(state, noise, felt, damping)
        trial = at(share)
        now, then = (whitened(one.products, noise)[-1, -1] for one in (state, trial))
        if then <= now + _TOLERATED * noise.sigma**2:
            state, damping = trial, 0.2 * damping
            if promised > _FAR:
                noise = noise_at(state, noise)
        else:
            damping = max(10 * damping, 1e-3)
        if converged:
            break
    # What another parameter does on its bound may be lost: of (1 - a) exp(-b w) nothing at a = 1.
    felt &= _felt(state.products)
    noise = noise_at(state, noise)
    return _described(curve, state, noise, felt, points, span, medians, limit, converged)


def _span(
    curve: Curve, parameters: np.ndarray, medians: Mapping[str, float], limit: float, largest: float
) -> Span:
    """Densest about the peak of the curve, if that lies among the points."""
    usual = Span(1.0, _MIDDLE * largest, largest)
    lean, none = np.zeros((parameters.size, MISFITS)), np.zeros(MISFITS)
    everything = parameters.size + MISFITS
    bare = Law(curve, parameters, none, lean, np.zeros((everything,) * 2), usual, medians)
    peak = peak_of(bare, limit)
    middle = peak.slip if peak.found and peak.slip < largest else usual.middle
    return Span(peak.adhesion if peak.adhesion > 0 else 1.0, middle, largest)


def _felt(found: Products) -> np.ndarray:
    squares = np.diagonal(found.parts[:2].sum(axis=(0, 1)))[: found.derivatives]
    return np.sqrt(squares / found.points.sum()) >= _NO_INFLUENCE


def _step(
    state: _State, noise: RunNoise, felt: np.ndarray, damping: float
) -> tuple[np.ndarray, float]:
    """Shares one step ahead within the box, and by how much half the deviance is to fall."""
    white, share = whitened(state.products, noise), state.share
    hessian = np.where(felt[:, None] & felt, white[: felt.size, : felt.size], 0.0)
    gradient = np.where(felt, -white[: felt.size, -1], 0.0)
    box = np.zeros_like(share), np.ones_like(share)
    step = np.asarray(damped_step(share, gradient, hessian, damping + ROUNDING, *box))
    return np.clip(share + step, 0.0, 1.0), 0.5 * abs(float(step @ gradient)) / noise.sigma**2


def _described(
    curve: Curve,
    state: _State,
    noise: RunNoise,
    felt: np.ndarray,
    points: Points,
    span: Span,
    medians: Mapping[str, float],
    limit: float,
    converged: bool,
) -> MeasuredFit:
    share, found = state.share, state.products
    bound = felt & ((share <= 0) | (share >= 1))
    inside = felt & ~bound
    parameters, stretch = parameters_at(curve, share), stretch_at(curve, share)

    def law_under(noise: RunNoise) -> Law:
        lean, missed, covariance = _misfit(whitened(found, noise), noise, inside)
        scale = np.concatenate([stretch, np.ones(MISFITS)])
        covariance = covariance * scale[:, None] * scale
        return Law(curve, parameters, missed, lean * stretch[:, None], covariance, span, medians)

    def variance_under(noise: RunNoise) -> float:
        return float(peak.by_law @ law_under(noise).covariance @ peak.by_law)

    law = law_under(noise)
    peak = peak_of(law, limit)
    of_level = variance_under(noise)

    # Shares of the variance that the levels of the runs and the misfit have, each known no better
    # than by its own number of degrees of freedom (Satterthwaite 1946, Biometrics Bull. 2:110-114).
    tiny = np.finfo(float).tiny
    without = np.array(
        [variance_under(noise._replace(**{part: 0.0})) for part in ("scatter", "misfit")]
    )
    shares = np.clip(1 - without / max(of_level, tiny), 0.0, 1.0)
    rest = 1 - min(shares.sum(), 1.0)
    count, r = points.slip.size, noise.autocorrelation
    independent = max(count * (1 - r) / (1 + r) - inside.sum(), 1.0)
    own = (max(points.runs - 1, 1), MISFITS, independent)
    degrees = 1 / np.sum(np.array([*shares, rest]) ** 2 / own)
    white = variance_under(RunNoise(noise.sigma, 0.0, 0.0, 0.0))
    both = found.parts[:2].sum(axis=(0, 1))
    factors = np.concatenate([-law.lean / stretch[:, None] @ law.missed, law.missed])
    missed = factors @ both[:-2, :-2] @ factors
    return MeasuredFit(
        with_free_values(curve, parameters),
        medians,
        limit,
        " m/s" if limit == SLIP_VELOCITY_LIMIT else "",
        count,
        state.squares,
        noise,
        float(np.sqrt(missed / max(both[-2, -2], tiny))),
        law,
        bound,
        ~felt,
        peak,
        float(np.sqrt(peak.by_slip @ law.covariance @ peak.by_slip)) if peak.found else np.nan,
        float(np.sqrt(of_level)),
        float(degrees),
        float(count * min(white / max(of_level, tiny), 1.0)),
        left_out(found, noise, inside),
        found,
        converged,
    )


def _misfit(
    white: np.ndarray, noise: RunNoise, inside: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What the misfit has in common with the curve, its factors, and the covariance of both.

    The functions of the misfit less `lean` times the derivatives are orthogonal to these under the
    noise: the curve is then the nearest one, whatever it misses. The covariance is that of shares
    and factors, zero where held.
    """
    count = inside.size
    lean, missed = np.zeros((count, MISFITS)), np.zeros(MISFITS)
    covariance = np.zeros((count + MISFITS, count + MISFITS))
    matrix, _, used = normal_equations(white, 0.0, inside)
    own = inverse(matrix)
    covariance[used[:, None], used] = noise.sigma**2 * own
    if noise.misfit > 0:
        lean[used] = own @ white[used, count:-2]
        both, right, _ = normal_equations(white, noise.misfit, inside)
        of_misfit = inverse(both)[used.size :, used.size :]
        covariance[count:, count:] = noise.sigma**2 * of_misfit
        missed = solve(both, right)[used.size :]
    return lean, missed, covariance
