"""The noise of a measurement, and what it leaves of the information."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg.lapack import dgttrf, dgttrs

from adhesion_jax.planning.truth import Sensitivity


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
    products = _weighted_products(noise, sensitivity.slope, signals, starts)
    return _with_levels(noise, products).sum(axis=0)


def _weighted_products(
    noise: Noise,
    slope: Float[np.ndarray, " points"],
    signals: Float[np.ndarray, "signals points"],
    starts: Int[np.ndarray, " runs"],
) -> Float[np.ndarray, "runs signals signals"]:
    """X V^-1 X' of each run: X the signals, V the covariance without the levels of the runs.

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
    return np.stack(products, axis=1)


def _with_levels(
    noise: Noise, products: Float[np.ndarray, "runs signals signals"]
) -> Float[np.ndarray, "runs others others"]:
    """The products of all signals but the last, the adhesion, whose random size is a run's level.

    By Sherman and Morrison: (V + s^2 u u')^-1 = V^-1 - V^-1 u u' V^-1 s^2/(1 + s^2 u' V^-1 u).
    """
    along = products[:, :-1, -1]
    share = noise.run_scatter**2 / (1 + noise.run_scatter**2 * products[:, -1, -1])
    return products[:, :-1, :-1] - share[:, None, None] * along[:, :, None] * along[:, None, :]
