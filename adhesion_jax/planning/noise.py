"""The noise of a measurement, what it leaves of the information, and its size in a record."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg.lapack import dgttrf, dgttrs
from scipy.optimize import minimize

from adhesion_jax.planning.truth import Sensitivity

#: Largest number of samples from which the noise of a record is estimated: whole runs, evenly
#: chosen.
_MOST_SAMPLES = 20_000

#: Number of samples of a piece of a single long run.
_PIECE = 2000

#: Largest autocorrelation that is estimated: noise beyond it would be a drift.
_MOST_CORRELATED = 0.995

#: First trials of the search for the noise: log of sigma over the residual, the inverse hyperbolic
#: tangent of the autocorrelation, and the scatter between runs.
_TRIAL = np.array([[0.0, 0.2, 0.01], [-0.5, 0.2, 0.01], [0.0, 1.0, 0.01], [0.0, 0.2, 0.05]])


class Noise(NamedTuple):
    """The error of adhesion at sample k of run r is e(k) + g(k) d(k) + u(k) a(r).

    e is first-order autoregressive, of standard deviation `sigma` and correlation
    `autocorrelation` between neighbours; d the independent error of the slip, of standard
    deviation `slip_noise`, and g the slope of the curve there; a a factor of the run on the
    adhesion u, of standard deviation `run_scatter`.

    Slip errors are taken to the first order: what they change in the expected adhesion, half the
    curvature of the curve times their variance, is left out, and so is what their variance would
    tell of the slope.
    """

    sigma: float
    autocorrelation: float = 0.0
    run_scatter: float = 0.0
    slip_noise: float = 0.0


def information_under(
    noise: Noise, sensitivity: Sensitivity, starts: Int[np.ndarray, " runs"]
) -> Float[np.ndarray, "free free"]:
    """Fisher information J' V^-1 J of the samples of runs that begin at `starts`.

    J is the sensitivity to the parameters, V the covariance of the noise.
    """
    signals = np.vstack([sensitivity.by_parameters, sensitivity.adhesion])
    products, _ = _weighted_products(noise, sensitivity.slope, signals, starts)
    return _with_levels(noise, products).sum(axis=0)


def _weighted_products(
    noise: Noise,
    slope: Float[np.ndarray, " points"],
    signals: Float[np.ndarray, "signals points"],
    starts: Int[np.ndarray, " runs"],
) -> tuple[Float[np.ndarray, "runs signals signals"], float]:
    """X V^-1 X' of each run and log det V: X the signals, V the covariance without run levels.

    With Q the inverse covariance of e, which is tridiagonal, and D the variance that errors of the
    slip make, V^-1 = (Q^-1 + D)^-1 = (I + Q D)^-1 Q: one tridiagonal system, exact, for D = 0 too.
    """
    points, r = slope.size, noise.autocorrelation
    unit = 1 / (noise.sigma**2 * (1 - r**2))
    first, last = np.zeros(points, dtype=bool), np.zeros(points, dtype=bool)
    first[starts], last[np.append(starts[1:], points) - 1] = True, True
    middle = unit * (1 + r**2 - r**2 * first - r**2 * last)
    beside = np.where(last, 0.0, -unit * r)[:-1]  # of Q, between a sample and the next
    filtered = middle * signals
    filtered[:, 1:] += beside * signals[:, :-1]
    filtered[:, :-1] += beside * signals[:, 1:]

    variance = (slope * noise.slip_noise) ** 2
    *factors, _ = dgttrf(beside * variance[:-1], 1 + middle * variance, beside * variance[1:])
    weighted = np.ascontiguousarray(dgttrs(*factors, filtered.T)[0].T)
    products = [np.add.reduceat(row * weighted, starts, axis=1).T for row in signals]
    of_q = starts.size * np.log(1 - r**2) + points * np.log(unit)
    return np.stack(products, axis=1), float(np.log(np.abs(factors[1])).sum() - of_q)


def _with_levels(
    noise: Noise, products: Float[np.ndarray, "runs signals signals"]
) -> Float[np.ndarray, "runs others others"]:
    """The products of all signals but the last, the adhesion, whose random size is a run's level.

    By Sherman and Morrison: (V + s^2 u u')^-1 = V^-1 - V^-1 u u' V^-1 s^2/(1 + s^2 u' V^-1 u).
    """
    along = products[:, :-1, -1]
    share = noise.run_scatter**2 / (1 + noise.run_scatter**2 * products[:, -1, -1])
    return products[:, :-1, :-1] - share[:, None, None] * along[:, :, None] * along[:, None, :]


def noise_of_record(
    residual: Float[np.ndarray, " points"],
    sensitivity: Sensitivity,
    starts: Int[np.ndarray, " runs"],
    slip_noise: float,
    in_time: bool,
) -> Noise:
    """The noise under which the residual of a fitted curve is most likely; that of slip is known.

    By restricted maximum likelihood, the parameters of the curve being integrated out to the first
    order (Patterson and Thompson 1971, Biometrika 58:545-554). Where the order in time is unknown
    (not `in_time`) there is no autocorrelation, and with one run no scatter between runs.
    """
    chosen, of_chosen = some_runs(residual.size, starts, _MOST_SAMPLES)
    adhesion, slope = sensitivity.adhesion[chosen], sensitivity.slope[chosen]
    signals = np.vstack([sensitivity.by_parameters[:, chosen], residual[chosen], adhesion])
    size = float(np.sqrt(np.mean(residual**2)))

    def noise_at(place: Float[np.ndarray, " 3"]) -> Noise:
        correlation = _MOST_CORRELATED * np.tanh(abs(place[1])) if in_time else 0.0
        scatter = abs(place[2]) if starts.size > 1 else 0.0
        return Noise(size * float(np.exp(place[0])), float(correlation), float(scatter), slip_noise)

    def loss(place: Float[np.ndarray, " 3"]) -> float:
        noise = noise_at(place)
        products, spread = _weighted_products(noise, slope, signals, of_chosen)
        whole = _with_levels(noise, products).sum(axis=0)
        information, along = whole[:-1, :-1], whole[:-1, -1]
        scale = np.sqrt(np.diagonal(information))
        one_scale = information / np.outer(scale, scale)
        misfit = whole[-1, -1] - along / scale @ np.linalg.lstsq(one_scale, along / scale)[0]
        spread += np.log1p(noise.run_scatter**2 * products[:, -1, -1]).sum()
        return float(misfit + spread + np.linalg.slogdet(information)[1])

    found = minimize(loss, _TRIAL[0], method="Nelder-Mead", options={"initial_simplex": _TRIAL})
    return noise_at(found.x)


def some_runs(
    points: int, starts: Int[np.ndarray, " runs"], most: int
) -> tuple[Int[np.ndarray, " chosen"], Int[np.ndarray, " fewer"]]:
    """Samples of whole runs, evenly chosen, about `most` at most, and where their runs begin.

    A single run is cut into pieces, which then are the runs.
    """
    if points <= most:
        return np.arange(points), starts
    if starts.size == 1:
        starts = np.arange(0, points, _PIECE)
    ends = np.append(starts[1:], points)
    kept = slice(None, None, -(-points // most))
    chosen = [np.arange(start, end) for start, end in zip(starts[kept], ends[kept], strict=True)]
    begins = np.cumsum([0, *(run.size for run in chosen[:-1])])
    return np.concatenate(chosen), begins
