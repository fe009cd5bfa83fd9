"""The noise of a campaign: its covariance, the likelihood of a residual, and the best estimate.

The error of adhesion at point t of a run is e(t) + g(t) d(t) + u(t) a: e is AR(1) noise of
standard deviation sigma, d what is unknown of the slip with g the slope of the curve there, and a
a factor of the run on the predicted adhesion u, of standard deviation run_scatter. The first two
are taken as a Markov chain: each point is conditioned on the one before. That is exact for AR(1)
noise and for independent errors of the slip, and keeps variances and the covariances of neighbours
where both act together.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.optimize import minimize

#: Largest autocorrelation that is considered: noise beyond it is a drift.
_MOST = 0.995

#: A run needs so many points for its autocorrelation to be seen beside its own level.
_SHORT = 5

#: Places along the autocorrelation and the scatter of runs of a first grid, and of those about its
#: best that refine it.
_GRIDS = (21, 9, 9, 9, 9, 9, 9)

#: Largest variance of the level of a run, relative to what the noise within the run makes of it.
_LARGEST_RATIO = 1e8


class Noise(NamedTuple):
    """The parameters of the noise; arrays of NumPy before they go into a program, of jax inside."""

    weight: Float[Any, "runs points"]  # 1 where there is a point that counts, else 0
    sigma: Float[Any, ""]
    autocorrelation: Float[Any, ""]
    run_scatter: Float[Any, ""]
    variance: Float[Any, "runs points"]  # of g d
    covariance: Float[Any, "runs points"]  # of g d with that of the point before


def white_noise(points: np.ndarray, sigma: float) -> Noise:
    """No correlation, no scatter of the runs, exact slip."""
    nothing = np.zeros_like(points)
    return Noise(
        points, np.array(sigma), np.array(0.0), np.array(0.0), nothing, np.zeros_like(points)
    )


def whitened(
    noise: Noise, level: Float[Array, "runs points"], signal: Float[Array, "runs points"]
) -> Float[Array, "runs points"]:
    """L^-1 signal with L L' the covariance of the noise of each run; 0 where nothing counts."""
    carry, spread = chain(noise)
    direction = _innovations(noise, carry, spread, level)
    # The covariance I + s^2 u u' has the inverse root I - (1 - 1/sqrt(1 + s^2 |u|^2)) e e'.
    size = jnp.sum(direction**2, axis=1, keepdims=True)
    shrink = 1 - 1 / jnp.sqrt(1 + noise.run_scatter**2 * size)
    white = _innovations(noise, carry, spread, signal)
    along = jnp.sum(white * direction, axis=1, keepdims=True)
    return white - shrink * along * direction / jnp.maximum(size, 1e-300)


def determinant(noise: Noise, level: Float[Array, "runs points"]) -> Float[Array, " runs"]:
    """Half the log determinant of the covariance of each run."""
    carry, spread = chain(noise)
    direction = _innovations(noise, carry, spread, level)
    size = jnp.sum(direction**2, axis=1)
    logs = jnp.where(noise.weight > 0, jnp.log(spread), 0.0)
    return logs.sum(axis=1) + 0.5 * jnp.log1p(noise.run_scatter**2 * size)


def chain(noise: Noise) -> tuple[Array, Array]:
    """What a point takes over from the one before, and the spread of what is new in it."""
    own = noise.sigma**2 + noise.variance
    both = (noise.weight[:, 1:] > 0) & (noise.weight[:, :-1] > 0)
    shared = noise.autocorrelation * noise.sigma**2 + noise.covariance[:, 1:]
    shared = jnp.where(both, shared, 0.0)
    carry = shared / own[:, :-1]
    fresh = own[:, 1:] - carry * shared
    spread = jnp.sqrt(jnp.maximum(fresh, 1e-9 * own[:, 1:]))
    first = jnp.sqrt(own[:, :1])
    return (
        jnp.concatenate([jnp.zeros_like(first), carry], axis=1),
        jnp.concatenate([first, spread], axis=1),
    )


def _innovations(noise: Noise, carry: Array, spread: Array, signal: Array) -> Array:
    before = jnp.concatenate([signal[:, :1], signal[:, :-1]], axis=1)
    return jnp.where(noise.weight > 0, (signal - carry * before) / spread, 0.0)


def estimated(
    start: Noise, residual: np.ndarray, level: np.ndarray, in_order: bool, by_run: bool
) -> Noise:
    """The noise of greatest likelihood for a residual, [runs, points].

    `level` is the predicted adhesion, which the factor of a run multiplies. The points of a run are
    correlated only where they are `in_order`, the runs have levels only if they are runs (`by_run`)
    and not blocks of one. What `start` says of the noise of the slip is kept.
    """
    inside = start.weight > 0
    residual, level = np.where(inside, residual, 0.0), np.where(inside, level, 0.0)
    long_enough = inside.sum() > _SHORT * max(int(inside.any(1).sum()), 1)
    in_order = in_order and bool(long_enough)
    by_run = by_run and int(inside.any(1).sum()) > 2
    if start.variance.any():
        return _with_slip(start, residual, level, in_order, by_run)
    sums = _sums(start.weight, residual, level)
    lows, highs = np.array([0.0, 0.0]), np.array([_MOST * in_order, 1.0 * by_run])
    best = np.zeros(2)
    for turn, places in enumerate(_GRIDS):
        axes = [np.linspace(low, high, places) for low, high in zip(lows, highs, strict=True)]
        if turn == 0 and in_order:
            axes[0] = _MOST * np.linspace(0.0, 1.0, places) ** 0.5
        r, place = (axis.ravel() for axis in np.meshgrid(*axes, indexing="ij"))
        losses = _profile(sums, r, _ratio(place))[0]
        best = np.array([r[losses.argmin()], place[losses.argmin()]])
        reach = (highs - lows) / places * (1.5 if turn else 4.0)
        lows = np.maximum(best - reach, 0.0)
        highs = np.minimum(best + reach, [_MOST * in_order, 1.0 * by_run])
    ratio = _ratio(best[1:])
    _, variance = _profile(sums, best[:1], ratio)
    sigma = max(float(np.sqrt(variance[0])), 1e-150)
    scatter = float(np.sqrt(ratio[0] / sums.mean_size)) * sigma if sums.mean_size > 0 else 0.0
    return start._replace(
        sigma=np.array(sigma), autocorrelation=np.array(best[0]), run_scatter=np.array(scatter)
    )


def _ratio(place: np.ndarray) -> np.ndarray:
    """From 0 to 1 to the variance of a level from 0 to the largest: about logarithmic, and 0."""
    return np.expm1(place * np.log1p(_LARGEST_RATIO * 1e3)) / 1e3


class _Sums(NamedTuple):
    """Products of residual and level with themselves and each other, [3, 4, runs].

    First axis: residual squared, level squared, residual times level. Second: points without one
    before; the others; they and the ones before, crossed; the ones before.
    """

    products: np.ndarray
    points: int
    starts: int
    mean_size: float  # of the level of a run, squared


def _sums(weight: np.ndarray, residual: np.ndarray, level: np.ndarray) -> _Sums:
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
    return _Sums(
        np.array([parts(*pair) for pair in pairs]),
        int(inside.sum()),
        int((inside & ~linked).sum()),
        float((level**2).sum()) / used,
    )


def _profile(sums: _Sums, r: np.ndarray, ratio: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Half the deviance at its best sigma, and that sigma squared, [choices].

    `ratio` is run_scatter^2 mean_size/sigma^2.
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
    """The same where the slip is noisy: no sums are left, and the likelihood is searched."""

    def noise_at(at: np.ndarray) -> Noise:
        return start._replace(
            sigma=np.exp(at[0]),
            autocorrelation=np.array(_MOST / (1 + np.exp(-at[1])) if in_order else 0.0),
            run_scatter=np.exp(at[2]) if by_run else np.array(0.0),
        )

    def loss(at: np.ndarray) -> float:
        return _half_deviance(noise_at(at), residual, level)

    inside = start.weight > 0
    calm = residual[inside & (start.variance <= np.median(start.variance[inside]))]
    first = np.log(max(float(np.sqrt(np.mean(calm**2))), 1e-12))
    begun = np.array([first, -1.0, -6.0])
    known = float(start.sigma) > 0 and float(start.autocorrelation) > 0
    if known:
        share = np.clip(float(start.autocorrelation) / _MOST, 1e-3, 1 - 1e-3)
        begun = np.array(
            [
                np.log(float(start.sigma)),
                np.log(share / (1 - share)),
                np.log(max(float(start.run_scatter), 1e-4)),
            ]
        )
    simplex = begun + np.vstack([np.zeros(3), np.diag([0.3, 1.0, 1.0])])
    found = minimize(
        loss,
        begun,
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "xatol": 3e-3, "fatol": 1e-2, "maxfev": 160},
    )
    return noise_at(found.x)


def _half_deviance(noise: Noise, residual: np.ndarray, level: np.ndarray) -> float:
    """As `whitened` and `determinant` have it, in NumPy: a search of few points."""
    inside = noise.weight > 0
    own = noise.sigma**2 + noise.variance
    shared = noise.autocorrelation * noise.sigma**2 + noise.covariance[:, 1:]
    shared = np.where(inside[:, 1:] & inside[:, :-1], shared, 0.0)
    carry = shared / own[:, :-1]
    spread = own.copy()
    spread[:, 1:] = np.maximum(own[:, 1:] - carry * shared, 1e-9 * own[:, 1:])
    error, direction = residual.copy(), level.copy()
    error[:, 1:] -= carry * residual[:, :-1]
    direction[:, 1:] -= carry * level[:, :-1]
    precision = np.where(inside, 1 / spread, 0.0)
    size = (direction**2 * precision).sum(1)
    along = (error * direction * precision).sum(1)
    squares = (error**2 * precision).sum() - (
        noise.run_scatter**2 * along**2 / (1 + noise.run_scatter**2 * size)
    ).sum()
    logs = np.log(spread[inside]).sum() + np.log1p(noise.run_scatter**2 * size).sum()
    return 0.5 * float(squares + logs)
