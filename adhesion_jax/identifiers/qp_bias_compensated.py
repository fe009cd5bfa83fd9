"""The quadratic program of Qian et al. 2024 without the bias of noise in the regressors."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import PRNGKeyArray

from adhesion_jax.curves import Scalar
from adhesion_jax.identifiers.base import Estimate
from adhesion_jax.identifiers.kiencke_linear import (
    Normal,
    OnlineKiencke,
    covariance,
    discounted,
    forgetting,
    no_samples,
    online_estimate,
    powers,
    regression,
    solve_in_box,
    start_of,
)
from adhesion_jax.identifiers.online import OnlineState, Sample, begin
from adhesion_jax.identifiers.pairs import Symmetric, Vector, no_matrix, square
from adhesion_jax.optim.arrays import Count, Value
from adhesion_jax.records import Known

#: The noise variance is taken as at most this share of the one that would leave H - s^2 M without
#: curvature: after a switch the residuals are larger than noise, and the program must stay convex.
_MOST = 0.5


class NoiseSums(NamedTuple):
    """The bias by noise of variance 1: H is too large by m = sum w [l^2, l^3; l^3, l^4].

    f is too small by [sum w l, m11]. Its variance is estimated by sum w e^2/D^2 over sum w.
    """

    m: Symmetric
    f1: Value
    squares: Value
    weights: Value


class CompensatedRecursion(NamedTuple):
    normal: Normal
    noise: NoiseSums
    samples: Count
    x: Vector
    eta: Value


class BiasCompensatedProgram(OnlineKiencke):
    """Algorithm 2 of Qian et al. 2024 on (H - s^2 M) x = f + s^2 [sum w l, sum w l^2].

    With mu = mu_0 + n, U U' is too large by s^2 [l^2, l^3; l^3, l^4] on average and U Z too small
    by s^2 [l, l^2]. e = Z - U'x = D (mu_hat - mu), so the mean of e^2/D^2 estimates s^2.
    Source: Söderström 2007, Automatica 43:939-958 (bias-eliminating least squares), for this case.
    """

    RESETS = False

    eta_least: Scalar
    eta_most: Scalar
    gain: Scalar

    def init(self, known: Known, key: PRNGKeyArray) -> OnlineState:
        noise, eta = NoiseSums(no_matrix(), *3 * [jnp.zeros(())]), jnp.asarray(self.eta_most)
        recursion = CompensatedRecursion(no_samples(), noise, jnp.int32(0), start_of(known), eta)
        return begin(known, recursion)

    def estimate(self, state: OnlineState) -> Estimate:
        normal, noise, samples, _, eta = state.recursion
        clear = compensated(normal, noise, variance(normal, noise))
        return online_estimate(state, covariance(clear), samples > 1, eta)

    def step(
        self, known: Known, recursion: CompensatedRecursion, sample: Sample
    ) -> CompensatedRecursion:
        taken, slip, adhesion, _ = sample
        row, size = regression(known, slip, adhesion), powers(jnp.abs(slip))
        eta = forgetting(
            known, slip, adhesion, recursion.x, self.eta_least, self.eta_most, self.gain
        )
        # With zeros for the sample, nothing changes as soon as nothing is forgotten.
        factor, one = jnp.where(taken, eta, 1.0), jnp.where(taken, 1.0, 0.0)
        normal = discounted(recursion.normal, row, factor, jnp.ones(()))
        old = recursion.noise
        noise = NoiseSums(
            factor * old.m + square(size),
            factor * old.f1 + size.a,
            factor * old.squares,  # the residual of this sample is added below, once x is known
            factor * old.weights + one,
        )
        s2 = variance(normal, noise)
        clear = compensated(normal, noise, s2)
        x, eta = jax.tree.map(
            partial(jnp.where, taken),
            (solve_in_box(known, clear), eta),
            (recursion.x, recursion.eta),
        )
        error, d = row.z - row.u.dot(x), 1 + size.dot(x)
        noise = noise._replace(squares=noise.squares + (error / d) ** 2)
        # What the sample adds to the equation: U e + s^2 D [l, l^2] in place of U e alone.
        score = error * row.u + s2 * d * size
        normal = normal._replace(g=normal.g + square(score))
        return CompensatedRecursion(normal, noise, recursion.samples + taken, x, eta)


def variance(normal: Normal, noise: NoiseSums) -> Value:
    """Noise variance of the adhesion, at most a share of the least s^2 with det(H - s^2 M) = 0."""
    h, m = normal.h, noise.m
    curvature, spread = jnp.maximum(h.determinant(), 0.0), m.determinant()
    mixed = h.a * m.c + h.c * m.a - 2 * h.b * m.b
    inside = mixed**2 - 4 * spread * curvature
    # With one sample the root is of zero, where its derivative is no number.
    root = jnp.where(inside > 0, jnp.sqrt(jnp.where(inside > 0, inside, 1.0)), 0.0)
    least = 2 * curvature / jnp.where(mixed + root > 0, mixed + root, 1.0)
    return jnp.minimum(noise.squares / jnp.maximum(noise.weights, 1.0), _MOST * least)


def compensated(normal: Normal, noise: NoiseSums, s2: Value) -> Normal:
    """The sums as they would be on average if the adhesion in the regressors were exact."""
    h, f = normal.h - s2 * noise.m, normal.f + s2 * Vector(noise.f1, noise.m.a)
    return normal._replace(h=h, f=f)


#: The settings are those of Algorithm 2.
qp_bias_compensated = BiasCompensatedProgram(0.971, 1.0, 2.0)
