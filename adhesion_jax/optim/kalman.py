"""Kalman filters of one measured number: what a belief predicts of it, and what it teaches.

The state does not move by itself: what it is to be spread by meanwhile is added to the covariance.
Source: Sarkka 2013, Bayesian Filtering and Smoothing, sections 4.3, 5.2 and 5.5. At the end, one
coefficient by recursive least squares whose forgetting follows its regressor.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.optim.arrays import Matrix, Value, Vector

Scalar = float | Value

#: The measured number, without its noise, from the state.
Model = Callable[[Vector], Value]


class Gaussian(NamedTuple):
    """A belief about the state."""

    mean: Vector
    covariance: Matrix


class Predicted(NamedTuple):
    """The measured number as a belief has it: without noise, and how it goes with the state."""

    mean: Value
    variance: Value
    cross: Vector  # its covariance with the state


def extended(belief: Gaussian, model: Model) -> Predicted:
    """By the slope of the model at the mean (extended Kalman filter)."""
    value, push = jax.linearize(model, belief.mean)
    slope = jax.vmap(push)(jnp.eye(belief.mean.size))
    cross = jnp.sum(belief.covariance * slope, axis=-1)
    return Predicted(value, jnp.sum(slope * cross), cross)


def unscented(
    belief: Gaussian, model: Model, alpha: Scalar, beta: Scalar, kappa: Scalar
) -> Predicted:
    """By the model at the mean and two points along each axis (unscented Kalman filter).

    The points are sqrt(n + h) standard deviations away, h = alpha^2 (n + kappa) - n.
    """
    mean, size = belief.mean, belief.mean.size
    spread = alpha**2 * (size + kappa)
    steps = jnp.sqrt(spread) * lower_root(belief.covariance).T
    middle = model(mean)
    values = jax.vmap(model)(jnp.concatenate([mean + steps, mean - steps]))
    share, centre = 1 / (2 * spread), 1 - size / spread
    predicted = centre * middle + share * jnp.sum(values)
    apart = values - predicted
    variance = (centre + 1 - alpha**2 + beta) * (middle - predicted) ** 2
    difference = apart[:size] - apart[size:]
    cross = share * jnp.sum(difference[:, None] * steps, axis=0)
    return Predicted(predicted, variance + share * jnp.sum(apart**2), cross)


def corrected(belief: Gaussian, predicted: Predicted, measured: Value, noise: Value) -> Gaussian:
    """The belief after the number was measured with noise of this variance."""
    gain = predicted.cross / (predicted.variance + noise)
    mean = belief.mean + gain * (measured - predicted.mean)
    return Gaussian(mean, belief.covariance - gain[:, None] * predicted.cross)


def lower_root(matrix: Matrix) -> Matrix:
    """The lower triangular L with L L' = matrix; a pivot that is not positive counts as zero.

    Number by number: in a batch, each is an array over the problems.
    """
    size = len(matrix)
    root: list[list[Float[Array, ""]]] = []
    for i in range(size):
        row: list[Float[Array, ""]] = []
        for j in range(i):
            inner = sum((row[k] * root[j][k] for k in range(j)), jnp.zeros(()))
            row.append((matrix[i, j] - inner) / jnp.where(root[j][j] > 0, root[j][j], jnp.inf))
        left = matrix[i, i] - sum((one**2 for one in row), jnp.zeros(()))
        row.append(jnp.sqrt(jnp.maximum(left, 0.0)))
        root.append(row + [jnp.zeros(())] * (size - 1 - i))
    return jnp.stack([jnp.stack(row) for row in root])


class SlopeStep(NamedTuple):
    """The coefficient and P after a sample, with its forgetting factor, gain and innovation."""

    theta: Float[Array, "..."]
    p: Float[Array, "..."]
    kappa: Float[Array, "..."]  # forgetting factor
    gain: Float[Array, "..."]
    scale: Float[Array, "..."]  # 1 + phi^2 P
    innovation: Float[Array, "..."]


def slope_step(
    theta: Float[Array, "..."],
    p: Float[Array, "..."],
    y: Float[Array, "..."],
    phi: Float[Array, "..."],
    gamma: Float[Array, "..."],
) -> SlopeStep:
    """The model y = theta phi, after Fang et al. 2018, Eq. 11.

    theta <- theta + P phi (y - theta phi)/(1 + phi^2 P),
    P <- P/(kappa (1 + phi^2 P)), kappa = 1/(1 + gamma phi^2).
    """
    scale = 1 + phi**2 * p
    gain = p * phi / scale
    innovation = y - theta * phi
    kappa = 1 / (1 + gamma * phi**2)
    return SlopeStep(theta + gain * innovation, p / (scale * kappa), kappa, gain, scale, innovation)
