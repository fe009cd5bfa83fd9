"""Kiencke's curve with its initial slope unknown too, by least squares that forget."""

from functools import partial
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from adhesion_jax.curves import Scalar, free_values
from adhesion_jax.curves.kiencke import Kiencke
from adhesion_jax.identifiers.online import Found, Sample, SelectiveMethod
from adhesion_jax.metrics.information import inverse_information
from adhesion_jax.optim import levenberg_marquardt
from adhesion_jax.optim.arrays import Count, Matrix, Value, Vector, Whether
from adhesion_jax.optim.levenberg_marquardt import Local, advance, normal_equations, undamped
from adhesion_jax.records import Known

#: Intervals of slip: the first one from 0 to this share of the largest slip, each of the others by
#: an equal factor up to the largest one.
_BINS, _LEAST = 64, 1e-3

#: Most damping that is left for the next sample: a thousandth of a step of Gauss and Newton.
_MOST_DAMPED = 1e3

#: An estimate has converged where the optimum is nearer than this share of a standard error, or of
#: the adhesion, which is as far as rounding lets it come to data without noise.
_NEAR, _ROUNDING = 0.1, 1e-10


class Binned(NamedTuple):
    """Sums over the samples by their slip, each a factor less for each sample after it."""

    products: Float[Array, "bins 3 3"]  # of 1, the slip over that of the bin less 1, and adhesion
    squares: Float[Array, " bins"]  # of the weights
    x: Vector  # a0, p1 and p2
    damping: Value
    samples: Count


class Means(NamedTuple):
    """Of the samples in each bin; where it is empty, weight and adhesion are 0."""

    weight: Float[Array, " bins"]
    slip: Float[Array, " bins"]
    adhesion: Float[Array, " bins"]
    #: Sums about these means: of slip squared, slip and adhesion, adhesion squared.
    within: tuple[Float[Array, " bins"], Float[Array, " bins"], Float[Array, " bins"]]


class KienckeFree(SelectiveMethod):
    """The least sum w (mu - a0 l/(1 + p1 l + p2 l^2))^2, w = factor^(number of samples since).

    For a rail whose initial slope is not known. The linear form mu = a0 l - p1 l mu - p2 l^2 mu
    has the noise of mu among its regressors, which leaves its least squares no footing once the
    slope is unknown: on He's wet rail, noise .01, mu_max is off by 85 %. So the samples are summed
    in intervals of slip, narrow enough to be taken for points, and the curve itself is fitted to
    their means inside the box, two steps of Levenberg and Marquardt a sample from the last
    estimate. No linearisation of the past stays in the sums. The covariance is that of noise
    without memory, H^-1 G H^-1 with H = sum w g g' and G = sum w^2 g g', g the derivative of mu by
    the parameters.
    """

    RESETS = False
    EVALUATIONS = 3  # at the last estimate, and after each of two steps

    factor: Scalar

    def accepts(self, known: Known) -> str | None:
        curve = known.curve
        all_free = type(curve) is Kiencke and curve.free == ("a0", "p1", "p2")
        if all_free and "mu_max" in known.asked:
            return None
        return "it is written for Kiencke's curve with a0, p1 and p2 unknown"

    def initial(self, known: Known, key: PRNGKeyArray) -> Binned:
        x = free_values(known.curve)
        damping = levenberg_marquardt.begin(x).damping
        none = jnp.zeros((_BINS, 3, 3)), jnp.zeros(_BINS)
        return Binned(*none, x, damping, jnp.int32(0))

    def tells(self, sums: Binned, sample: Sample) -> Whether:
        """A sample at slip 0 says nothing of the curve."""
        return sample.slip > 0

    def after(self, known: Known, sums: Binned, sample: Sample) -> Binned:
        _, size, adhesion, _ = sample
        centres = centres_of(known)
        place = jnp.sum(size >= edges_of(known))
        row = jnp.stack([jnp.ones(()), size / centres[place] - 1, adhesion])
        here = jnp.where(jnp.arange(_BINS) == place, 1.0, 0.0)
        products = self.factor * sums.products + here[:, None, None] * jnp.outer(row, row)
        squares = jnp.square(self.factor) * sums.squares + here
        evaluate = partial(evaluated, means_of(products, centres, sums.x))
        search = levenberg_marquardt.begin(sums.x)._replace(damping=sums.damping)
        for _ in range(self.EVALUATIONS):
            search = advance(evaluate, search, known.lower, known.upper, jnp.zeros(()))
        damping = jnp.minimum(search.damping, _MOST_DAMPED)
        return Binned(products, squares, search.x, damping, sums.samples + 1)

    def found(self, known: Known, sums: Binned) -> Found:
        means, x = means_of(sums.products, centres_of(known), sums.x), sums.x
        local = evaluated(means, x)
        variance, covariance = noise_of(known, sums, means, local)
        step, regular = undamped(x, local, known.lower, known.upper)
        size = jnp.sum(means.weight * jnp.square(means.adhesion))
        near = jnp.maximum(_NEAR**2 * variance, _ROUNDING**2 * size)
        left = -jnp.sum(step * local.gradient)  # step' H step, twice what it takes from the loss
        # Of points at two slips rounding may make a Jacobian of full rank.
        enough = (sums.samples > x.size) & (jnp.sum(means.weight > 0) >= x.size) & regular
        return Found(x, covariance, enough & (left <= near), jnp.asarray(self.factor, float))


def edges_of(known: Known) -> Float[Array, " inner"]:
    """The slips between one bin and the next."""
    return known.slip_limit * jnp.asarray(np.geomspace(_LEAST, 1.0, _BINS)[:-1])


def centres_of(known: Known) -> Float[Array, " bins"]:
    """A slip in each bin."""
    ends = np.append(0.0, np.geomspace(_LEAST, 1.0, _BINS))
    return known.slip_limit * jnp.asarray((ends[1:] + ends[:-1]) / 2)


def means_of(
    products: Float[Array, "bins 3 3"], centres: Float[Array, " bins"], x: Vector
) -> Means:
    """The means of the bins, as points of the curve with about these parameters.

    The mean of a curve over a bin is mu(mean slip) + mu''/2 times the variance of the slip in it.
    """
    weight = products[:, 0, 0]
    total = jnp.where(weight > 0, weight, 1.0)
    means = products[:, 0, 1:] / total[:, None]
    slip = centres * (1 + means[:, 0])
    apart = products[:, 1:, 1:] - weight[:, None, None] * means[:, :, None] * means[:, None]
    within = centres**2 * apart[:, 0, 0], centres * apart[:, 0, 1], apart[:, 1, 1]
    d = 1 + x[1] * slip + x[2] * slip**2
    bend = -2 * x[0] * (x[1] + 3 * x[2] * slip - x[2] ** 2 * slip**3) / d**3
    return Means(weight, slip, means[:, 1] - bend / 2 * within[0] / total, within)


def evaluated(means: Means, x: Vector) -> Local:
    """Half the weighted sum of squares of the means, and its derivatives."""
    slip, root = means.slip, jnp.sqrt(means.weight)
    by_a0 = root * slip / (1 + x[1] * slip + x[2] * slip**2)
    by_p1 = -x[0] * by_a0 * by_a0 / jnp.where(root > 0, root, 1.0)
    return normal_equations([by_a0, by_p1, slip * by_p1], x[0] * by_a0 - root * means.adhesion)


def noise_of(known: Known, sums: Binned, means: Means, local: Local) -> tuple[Value, Matrix]:
    """The variance of the noise, and the covariance of a0, p1 and p2 that comes of it.

    Where the data do not determine them, NaN and the width of the box.
    """
    x = sums.x
    other = evaluated(means._replace(weight=sums.squares), x)
    inverse = inverse_information(local.hessian)
    # In a bin adhesion rises with slip, which is not noise.
    d = 1 + x[1] * means.slip + x[2] * means.slip**2
    rise = x[0] * (1 - x[2] * means.slip**2) / d**2
    of_slip, both, of_adhesion = means.within
    scatter = jnp.sum(of_adhesion - 2 * rise * both + rise**2 * of_slip)
    freedom = jnp.sum(means.weight) - jnp.sum(inverse * other.hessian)
    variance = jnp.maximum(2 * local.loss + scatter, 0.0) / jnp.maximum(freedom, 1e-3)
    found = variance * inverse @ other.hessian @ inverse
    enough = jnp.all(jnp.isfinite(found)) & (freedom > 0)
    width = jnp.diag(jnp.square(known.upper - known.lower))
    return variance, jnp.where(enough, found, width)


#: Some three hundred samples are remembered.
kiencke_free = KienckeFree(0.997)
