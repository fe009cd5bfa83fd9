"""What the samples of a measurement tell of a curve that is fitted by weighted least squares."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import solveh_banded

from adhesion_jax.inference.noise import RunNoise
from adhesion_jax.planning.truth import Sensitivity


class Information(NamedTuple):
    """Of the weighted sum of squares of the residuals, by the unknown parameters."""

    curvature: Float[np.ndarray, "free free"]  # H = J' W J
    score: Float[np.ndarray, "free free"]  # J' W V W J, the covariance of the gradient


def weights_under(noise: RunNoise, sensitivity: Sensitivity) -> Float[np.ndarray, " points"]:
    """The weights of `identify`, 1/(sigma^2 + (slope x noise of the slip)^2).

    What neighbours have in common is no part of them.
    """
    return 1 / (noise.sigma**2 + (sensitivity.slope * noise.slip_noise) ** 2)


def information_under(
    noise: RunNoise, sensitivity: Sensitivity, starts: Int[np.ndarray, " runs"]
) -> Information:
    """That of the samples of runs that begin at `starts`.

    J is the sensitivity to the parameters, W the weights, and V the covariance of the noise: that
    of e, of the errors of the slip, to the first order, and of both levels, each of which
    multiplies the adhesion (`inference.noise`).
    """
    weight = weights_under(noise, sensitivity)
    pull = weight * sensitivity.by_parameters
    along = pull * sensitivity.adhesion
    of_runs = np.add.reduceat(along, starts, axis=1)
    slow = np.exp(-1 / noise.slow_rows) if noise.slow_rows else 0.0
    score = (
        noise.sigma**2 * pull @ _correlated(pull, noise.autocorrelation, starts).T
        + (pull * (sensitivity.slope * noise.slip_noise) ** 2) @ pull.T
        + noise.slow_level**2 * along @ _correlated(along, slow, starts).T
        + noise.run_scatter**2 * of_runs @ of_runs.T
    )
    return Information(pull @ sensitivity.by_parameters.T, score)


def _correlated(
    columns: Float[np.ndarray, "free points"], r: float, starts: Int[np.ndarray, " runs"]
) -> Float[np.ndarray, "free points"]:
    """Each column times the correlations r^|lag| within runs, whose inverse is tridiagonal."""
    points = columns.shape[1]
    ends = np.zeros(points)  # of runs that a sample is: none, one, or both
    ends[starts] += 1
    ends[np.append(starts[1:], points) - 1] += 1
    bands = np.full((2, points), -r)
    bands[0, starts] = 0.0
    bands[1] = 1 + r**2 * (1 - ends)
    return (1 - r**2) * solveh_banded(bands, columns.T).T
