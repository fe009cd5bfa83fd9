"""Refined instrumental variables on Kiencke's linear form: recursive, robust, with resets."""

from dataclasses import replace

import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from adhesion_jax.curves import Scalar
from adhesion_jax.identifiers.innovations import followed_scale, huber_weight
from adhesion_jax.identifiers.kiencke_linear import regression
from adhesion_jax.identifiers.online import Found, Sample
from adhesion_jax.identifiers.pairs import square
from adhesion_jax.identifiers.young import (
    InstrumentSums,
    Young,
    YoungKiencke,
    along,
    at_the_start,
    curve_at,
    inverse,
    refitted,
    solution,
    voted,
)
from adhesion_jax.optim.arrays import Value
from adhesion_jax.records import Known


class RefinedInstruments(YoungKiencke):
    """(sum w zeta U') x = sum w zeta Z with zeta = mu_hat [l, l^2]/D^2, D = 1 + p1 l + p2 l^2.

    As Z - U'x = D (mu_hat - mu), the solution that agrees with its own instruments makes
    sum w r d mu_hat/d p zero, r = mu - mu_hat: it is the nonlinear fit, and the instruments,
    free of the noise of their sample, leave no bias. The weights are Huber's, min(1, huber/|nu|),
    nu = r over its standard deviation. While the estimate is young it is iterated on the samples
    kept; afterwards each sample is weighed once, with the estimate before it. When the votes of
    the last samples say that the curve has changed, only the voters are kept.

    Samples that tell nothing are passed over (`tells`).
    Source: Young 2011, Recursive Estimation and Time-Series Analysis, chapter 7; Huber 1981,
    Robust Statistics, sections 7.6 (covariance) and 5.1 (median deviation).
    """

    huber: Scalar
    gain: Scalar  # least gain of the scale
    prior: Scalar  # standard deviation of the start, as a share of the box

    def initial(self, known: Known, key: PRNGKeyArray) -> Young:
        return at_the_start(known)

    def found(self, known: Known, recursion: Young) -> Found:
        sums = recursion.sums
        return Found(recursion.x.array(), _covariance(sums), sums.number > 2, jnp.ones(()))

    def after(self, known: Known, recursion: Young, sample: Sample) -> Young:
        sums, nu = self._taken_up(known, recursion, sample)
        young = replace(recursion, sums=sums, x=solution(known, sums))
        young, reset = voted(young, sample, nu)
        # Noise comes from the sensor and not from the rail, so its scale is kept at a reset.
        scale = followed_scale(young.scale, nu, young.samples, self.gain)
        return refitted(known, replace(young, scale=scale), reset, self.huber, self.prior)

    def _taken_up(self, known: Known, young: Young, sample: Sample) -> tuple[InstrumentSums, Value]:
        """The sums with one more sample, and its innovation in standard deviations."""
        old, (_, size, adhesion, _) = young.sums, sample
        d, model = curve_at(known, young.x, size)
        ray = along(size)
        slope = model * size / d  # of -d mu_hat/d p, along the ray
        # Variance of the prediction over that of the noise.
        leverage = jnp.maximum(slope**2 * ray.dot(inverse(old).times(ray)), 0.0)
        residual = adhesion - model
        nu = residual / (young.scale * jnp.sqrt(1 + leverage))
        weight = huber_weight(nu, self.huber)
        u, z = regression(known, size, adhesion)
        zeta = weight * slope / d
        sums = InstrumentSums(
            old.h + zeta * u.a * square(ray),
            old.f + zeta * z * ray,
            old.number + 1,
            old.weights + weight,
            old.unclipped + (weight == 1),
            old.squares + (weight * residual) ** 2 / (1 + leverage),
        )
        return sums, nu


def _covariance(sums: InstrumentSums) -> Float[Array, "2 2"]:
    """Mean psi^2/(mean psi')^2 times the inverse information, psi = w r clipped by Huber.

    sum w zeta U' is the information times the mean weight; psi' is 1 where r is not clipped.
    """
    squared = sums.squares / jnp.maximum(sums.number - 2, 1)
    clipping = sums.weights * sums.number / jnp.maximum(sums.unclipped, 1) ** 2
    return squared * clipping * inverse(sums).array()


#: huber = 2 makes the root mean square error without outliers .5 % larger, and with three per cent
#: of them does as well as 1.5. gain = .02 lets the scale follow some fifty samples, so that its
#: standard error is 8 %. prior = .1: a deviation of a tenth of the box matters with a handful of
#: samples, or longer where p2 stays uncertain by hundreds (wet rail, ten times the noise).
riv = RefinedInstruments(2.0, 0.02, 0.1)
