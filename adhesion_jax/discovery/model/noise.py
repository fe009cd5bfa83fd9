"""The noise of measured runs: its covariance, the likelihood of a residual, and its estimation.

The error of adhesion at point t of a run is e(t) + g(t) d(t) + u(t) a: e is AR(1) noise of
standard deviation sigma (sigma/sqrt(w) at a point of weight w, the mean of several rows), d the
error of the slip with g the slope of the curve there, and a a
factor of the run on the predicted adhesion u, of standard deviation run_scatter. The slow part of
g d is a sum of a few modes of independent sizes. The rest of g d and e are taken together as a
Markov chain: each point is conditioned on the one before. That is exact for AR(1) noise alone and
for independent errors of the slip alone; where both act it keeps the variances and the covariances
of neighbours.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from scipy.optimize import minimize, minimize_scalar

#: Largest number of modes of each run for the slow part of the adhesion error due to slip errors.
MODES = 16

#: Largest autocorrelation that is considered: noise beyond it would be a drift.
_MOST_CORRELATED = 0.995

#: The autocorrelation is estimated only if runs have more points than this on average: in shorter
#: runs it cannot be separated from their levels. By hand.
_SHORT = 5

#: Numbers of places along the autocorrelation and along the run scatter: of a first grid, then of
#: finer ones, each about the best place of the one before.
_GRIDS = (21, 9, 9, 9, 9, 9, 9)

#: Largest variance of the level of a run, relative to that due to the noise within the run.
_LARGEST_RATIO = 1e8


class Noise(NamedTuple):
    """The parameters of the noise: NumPy arrays outside a program, jax arrays inside it."""

    #: How many independent rows a point is worth, 1 on average (`Problem.points`); 0: none.
    weight: Float[Any, "runs points"]
    sigma: Float[Any, ""]  # of a point of weight 1
    autocorrelation: Float[Any, ""]
    run_scatter: Float[Any, ""]
    variance: Float[Any, "runs points"]  # of g d, beside its modes
    covariance: Float[Any, "runs points"]  # of g d with that of the point before, likewise
    modes: Float[Any, "runs points modes"]  # of g d: their covariance is modes modes'


def white_noise(points: np.ndarray, sigma: float) -> Noise:
    """Noise without correlation or run scatter, of an exact slip; `points` are its weights."""
    size, no = np.array(sigma), np.array(0.0)
    nothing = np.zeros_like(points)
    return Noise(points, size, no, no, nothing, nothing, np.zeros((*points.shape, 0)))


def slip_variance(noise: Noise) -> np.ndarray:
    """The variance of adhesion due to errors of the slip, [runs, points]."""
    return np.asarray(noise.variance + (noise.modes**2).sum(axis=2))


class Whitening(NamedTuple):
    """L^-1, with L L' the covariance of the noise of each run.

    The innovations of the chain have the covariance I + V V', whose inverse root is I - V X V':
    with V'V = Q D Q', X = Q diag(f) Q' and f = 1/(r (1 + r)), r the root of 1 + D.
    """

    weight: Float[Any, "runs points"]
    carry: Float[Any, "runs points"]
    spread: Float[Any, "runs points"]
    columns: Float[Any, "runs points columns"]  # V: the level of the run, then the modes
    inner: Float[Any, "runs columns columns"]  # X
    growth: Float[Any, " runs"]  # half the log determinant of I + V V'
    slow: Bool[Any, ""]  # whether there are modes


def whitening(noise: Noise, level: np.ndarray) -> Whitening:
    """The whitening for a noise whose random level of a run multiplies `level`, [runs, points]."""
    carry, spread = chain(noise)
    signals = np.concatenate([(noise.run_scatter * level)[:, :, None], noise.modes], axis=2)
    fresh = signals.copy()
    fresh[:, 1:] -= carry[:, 1:, None] * signals[:, :-1]
    fresh = np.where(noise.weight[:, :, None] > 0, fresh / spread[:, :, None], 0.0)
    values, vectors = np.linalg.eigh(fresh.mT @ fresh)
    values = np.maximum(values, 0.0)
    root = np.sqrt(1 + values)
    runs, count = values.shape
    columns = np.zeros((*noise.weight.shape, 1 + MODES))
    columns[:, :, :count] = fresh
    inner = np.zeros((runs, 1 + MODES, 1 + MODES))
    inner[:, :count, :count] = (vectors / (root * (1 + root))[:, None]) @ vectors.mT
    growth = 0.5 * np.log1p(values).sum(axis=1)
    return Whitening(noise.weight, carry, spread, columns, inner, growth, np.array(count > 1))


def whitened(
    whitening: Whitening, signal: Float[Array, "runs points"]
) -> Float[Array, "runs points"]:
    """L^-1 signal; 0 where the weight is 0."""
    weight, carry, spread, columns, inner, _, slow = whitening
    white = _innovations(weight, carry, spread, signal)

    def of_all(white: Array) -> Array:
        along = jnp.einsum("rpk,rp->rk", columns, white)
        return white - jnp.einsum("rpk,rkl,rl->rp", columns, inner, along)

    def of_level(white: Array) -> Array:
        direction = columns[:, :, 0]
        along = inner[:, 0, 0] * jnp.sum(white * direction, axis=1)
        return white - along[:, None] * direction

    return jax.lax.cond(slow, of_all, of_level, white)


def determinant(whitening: Whitening) -> np.ndarray:
    """Half the log determinant of the covariance of the noise of each run, [runs]."""
    logs = np.where(whitening.weight > 0, np.log(whitening.spread), 0.0)
    return logs.sum(axis=1) + whitening.growth


def chain(noise: Noise) -> tuple[np.ndarray, np.ndarray]:
    """The regression of each point on the one before, and the standard deviation of its innovation.

    Both are [runs, points].
    """
    own, shared = _moments(noise)
    carry, spread = np.zeros_like(own), np.sqrt(own)
    carry[:, 1:] = shared / own[:, :-1]
    fresh = own[:, 1:] - carry[:, 1:] * shared
    spread[:, 1:] = np.sqrt(np.maximum(fresh, 1e-9 * own[:, 1:]))
    return carry, spread


def _moments(noise: Noise) -> tuple[np.ndarray, np.ndarray]:
    """Variance of each point, and covariance with the one before [runs, points - 1], of e + g d."""
    inside = noise.weight > 0
    size = noise.sigma / np.sqrt(np.where(inside, noise.weight, 1.0))
    shared = noise.autocorrelation * size[:, 1:] * size[:, :-1] + noise.covariance[:, 1:]
    return size**2 + noise.variance, np.where(inside[:, 1:] & inside[:, :-1], shared, 0.0)


def _innovations(weight: Array, carry: Array, spread: Array, signal: Array) -> Array:
    """The signal less its regression on the point before, in standard deviations."""
    before = jnp.concatenate([signal[:, :1], signal[:, :-1]], axis=1)
    return jnp.where(weight > 0, (signal - carry * before) / spread, 0.0)


class Sums(NamedTuple):
    """Products of residual and level with themselves and each other, [3, 4, runs].

    First axis: residual squared, level squared, residual times level. Second axis, the points that
    are summed over: those without a predecessor; those with one; the latter times their
    predecessors; the predecessors.
    """

    products: np.ndarray
    points: int
    starts: int  # points without a predecessor
    mean_size: float  # mean over runs of the sum of squares of the level


def estimated(
    start: Noise, residual: np.ndarray, level: np.ndarray, in_order: bool, by_run: bool
) -> Noise:
    """The noise of greatest likelihood for a residual, [runs, points].

    `level` [runs, points] is the predicted adhesion, which the factor of a run multiplies. An
    autocorrelation is estimated only if the points are `in_order`, a run scatter only `by_run`.
    Weights and noise of the slip are those of `start`.
    """
    inside = start.weight > 0
    residual, level = np.where(inside, residual, 0.0), np.where(inside, level, 0.0)
    runs = int(inside.any(1).sum())
    in_order = in_order and long_enough(int(inside.sum()), runs)
    by_run = by_run and runs > 2
    if start.variance.any() or start.modes.size:
        return _with_slip(start, residual, level, in_order, by_run)
    root = np.sqrt(start.weight)
    sums = _sums(start.weight, root * residual, root * level)
    sigma, autocorrelation, run_scatter = map(np.array, likeliest_of(sums, in_order, by_run))
    return start._replace(sigma=sigma, autocorrelation=autocorrelation, run_scatter=run_scatter)


def shared_part(residual: np.ndarray, worth: np.ndarray) -> float:
    """The likeliest f where the variance of each residual [points] is v (1/worth + f).

    It is the part of the noise that the rows of a block have in common, so that it does not fall
    with their number.
    """

    def loss(share: float) -> float:
        size = 1 / worth + share
        mean = max(float(np.mean(residual**2 / size)), 1e-300)
        return 0.5 * residual.size * float(np.log(mean)) + 0.5 * float(np.log(size).sum())

    if np.ptp(worth) == 0:
        return 0.0
    ends = np.log([1e-3 / worth.max(), 1e3 / worth.min()])
    found = minimize_scalar(lambda place: loss(float(np.exp(place))), bounds=ends, method="bounded")
    best = float(np.exp(found.x))
    return best if loss(best) < loss(0.0) else 0.0


def long_enough(points: int, runs: int) -> bool:
    """Whether an autocorrelation can be told from the levels of runs of so many points in all."""
    return points > _SHORT * max(runs, 1)


def likeliest_of(sums: Sums, in_order: bool, by_run: bool) -> tuple[float, float, float]:
    """Sigma, autocorrelation and run scatter of greatest likelihood for sums over runs."""
    lows, highs = np.array([0.0, 0.0]), np.array([_MOST_CORRELATED * in_order, 1.0 * by_run])
    best = np.zeros(2)
    for turn, places in enumerate(_GRIDS):
        axes = [np.linspace(low, high, places) for low, high in zip(lows, highs, strict=True)]
        if turn == 0 and in_order:
            axes[0] = _MOST_CORRELATED * np.linspace(0.0, 1.0, places) ** 0.5
        r, place = (axis.ravel() for axis in np.meshgrid(*axes, indexing="ij"))
        losses = _profile(sums, r, _ratio(place))[0]
        best = np.array([r[losses.argmin()], place[losses.argmin()]])
        reach = (highs - lows) / places * (1.5 if turn else 4.0)
        lows = np.maximum(best - reach, 0.0)
        highs = np.minimum(best + reach, [_MOST_CORRELATED * in_order, 1.0 * by_run])
    ratio = _ratio(best[1:])
    _, variance = _profile(sums, best[:1], ratio)
    sigma = max(float(np.sqrt(variance[0])), 1e-150)
    scatter = float(np.sqrt(ratio[0] / sums.mean_size)) * sigma if sums.mean_size > 0 else 0.0
    return sigma, float(best[0]), scatter


def _ratio(place: np.ndarray) -> np.ndarray:
    """The variance of a level at a place in [0, 1]: 0 at 0, then nearly logarithmic."""
    return np.expm1(place * np.log1p(_LARGEST_RATIO * 1e3)) / 1e3


def _sums(weight: np.ndarray, residual: np.ndarray, level: np.ndarray) -> Sums:
    inside = weight > 0
    linked = np.zeros_like(inside)
    linked[:, 1:] = inside[:, 1:] & inside[:, :-1]

    def parts(one: np.ndarray, other: np.ndarray) -> list[np.ndarray]:
        here = linked[:, 1:]
        crossed = one[:, 1:] * other[:, :-1] + one[:, :-1] * other[:, 1:]
        return [
            (one * other * (inside & ~linked)).sum(1),
            (one * other * linked).sum(1),
            0.5 * (crossed * here).sum(1),
            (one[:, :-1] * other[:, :-1] * here).sum(1),
        ]

    pairs = ((residual, residual), (level, level), (residual, level))
    used = max(int(inside.any(1).sum()), 1)
    return Sums(
        np.array([parts(*pair) for pair in pairs]),
        int(inside.sum()),
        int((inside & ~linked).sum()),
        float((level**2).sum()) / used,
    )


def _profile(sums: Sums, r: np.ndarray, ratio: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Half the deviance with the best sigma, and that sigma squared, [choices].

    A choice is an autocorrelation r and a ratio run_scatter^2 mean_size/sigma^2.
    """
    start, own, crossed, before = np.moveaxis(sums.products, 1, 0)
    factor = 1 / (1 - r**2)
    weights = np.stack([np.ones_like(r), factor, -2 * r * factor, r**2 * factor])
    quadratic = np.einsum("kc,kpr->pcr", weights, np.stack([start, own, crossed, before]))
    scatter = (ratio / max(sums.mean_size, 1e-300))[:, None]
    left = quadratic[0] - scatter * quadratic[2] ** 2 / (1 + scatter * quadratic[1])
    variance = np.maximum(left.sum(1) / max(sums.points, 1), 1e-300)
    loss = 0.5 * sums.points * np.log(variance)
    loss = loss + 0.5 * (sums.points - sums.starts) * np.log1p(-(r**2))
    return loss + 0.5 * np.log1p(scatter * quadratic[1]).sum(1), variance


def _with_slip(
    start: Noise, residual: np.ndarray, level: np.ndarray, in_order: bool, by_run: bool
) -> Noise:
    """`estimated` for a noisy slip, where sums do not suffice: the likelihood is searched."""

    def noise_at(at: np.ndarray) -> Noise:
        return start._replace(
            sigma=np.exp(at[0]),
            autocorrelation=np.array(_MOST_CORRELATED / (1 + np.exp(-at[1])) if in_order else 0.0),
            run_scatter=np.exp(at[2]) if by_run else np.array(0.0),
        )

    def loss(at: np.ndarray) -> float:
        return _half_deviance(noise_at(at), residual, level)

    inside = start.weight > 0
    extra = slip_variance(start)
    calm = (np.sqrt(start.weight) * residual)[inside & (extra <= np.median(extra[inside]))]
    first = np.log(max(float(np.sqrt(np.mean(calm**2))), 1e-12))
    begun = np.array([first, -1.0, -6.0])
    known = float(start.sigma) > 0 and float(start.autocorrelation) > 0
    if known:
        share = np.clip(float(start.autocorrelation) / _MOST_CORRELATED, 1e-3, 1 - 1e-3)
        begun = np.array(
            [
                np.log(float(start.sigma)),
                np.log(share / (1 - share)),
                np.log(max(float(start.run_scatter), 1e-4)),
            ]
        )
    found = minimize(
        loss,
        begun,
        method="L-BFGS-B",
        bounds=[(None, None), (-8.0, 8.0), (-12.0, 2.0)],
        options={"ftol": 1e-7, "gtol": 1e-2, "eps": 1e-4},
    )
    return noise_at(found.x)


def _half_deviance(noise: Noise, residual: np.ndarray, level: np.ndarray) -> float:
    """Half the deviance that `whitened` and `determinant` give, in NumPy, which is faster here."""
    inside = noise.weight > 0
    own, shared = _moments(noise)
    carry = shared / own[:, :-1]
    spread = own.copy()
    spread[:, 1:] = np.maximum(own[:, 1:] - carry * shared, 1e-9 * own[:, 1:])
    columns = np.concatenate([(noise.run_scatter * level)[:, :, None], noise.modes], axis=2)
    error, later = residual.copy(), columns.copy()
    error[:, 1:] -= carry * residual[:, :-1]
    later[:, 1:] -= carry[:, :, None] * columns[:, :-1]
    precision = np.where(inside, 1 / spread, 0.0)
    weighed = later * precision[:, :, None]
    size = np.eye(columns.shape[2]) + weighed.mT @ later
    along = (weighed * error[:, :, None]).sum(axis=1)
    explained = (along * np.linalg.solve(size, along[:, :, None])[:, :, 0]).sum()
    logs = np.log(spread[inside]).sum() + np.linalg.slogdet(size)[1].sum()
    return 0.5 * float((error**2 * precision).sum() - explained + logs)
