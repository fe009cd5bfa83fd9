"""Qian et al. 2024: a quadratic program at every sample, as printed and without its bias."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, PRNGKeyArray

from adhesion_jax.curves import Scalar
from adhesion_jax.identifiers.base import Flag
from adhesion_jax.identifiers.kiencke_linear import (
    Normal,
    OnlineKiencke,
    covariance,
    discounted,
    forgetting,
    no_samples,
    powers,
    regression,
    solve_in_box,
    start_of,
    with_residual,
)
from adhesion_jax.identifiers.online import Found, Sample
from adhesion_jax.identifiers.pairs import Symmetric, Vector, no_matrix, square
from adhesion_jax.optim.arrays import Count, Value, Whether
from adhesion_jax.records import Known

#: Information matrices before each of the last samples, the latest first.
History = tuple[Symmetric, ...]


class ProgramRecursion(NamedTuple):
    normal: Normal
    history: History
    samples: Count
    x: Vector
    eta: Value


class QuadraticProgram(OnlineKiencke):
    """H <- eta H + w U U', f <- eta f + w Z U, then the best x in the box, at every sample.

    The weight w of the sample is 1 or, where `weight_falls`, (2 - eta)/2 (Eq. 7 and 8, in which
    H and f both carry a factor of 2 more). eta follows the error (`forgetting`). Where
    `redistributes`, eta is `eta_most` whenever every element of the statistic S of two
    successive triples of information matrices lies between `low` and `high` (Eq. 10 to 17, with
    standard deviations where S_1 and S_2 are printed as variances, whose unit is another).
    """

    RESETS = False

    weight_falls: Flag
    eta_least: Scalar
    eta_most: Scalar
    gain: Scalar
    redistributes: Flag
    low: Scalar
    high: Scalar

    def initial(self, known: Known, key: PRNGKeyArray) -> ProgramRecursion:
        history, eta = 4 * (no_matrix(),), jnp.asarray(self.eta_most)
        return ProgramRecursion(no_samples(), history, jnp.int32(0), start_of(known), eta)

    def found(self, known: Known, recursion: ProgramRecursion) -> Found:
        normal, _, samples, x, eta = recursion
        return Found(x.array(), covariance(normal), samples > 1, eta)

    def step(self, known: Known, recursion: ProgramRecursion, sample: Sample) -> ProgramRecursion:
        old, history, samples, x, last = recursion
        row = regression(known, sample.slip, sample.adhesion)
        eta = forgetting(known, sample, x, self.eta_least, self.eta_most, self.gain)
        past = (old.h, *history)

        def redistributed() -> tuple[Value, History]:
            calm = _calm(row.u, past, self.low, self.high) & (samples >= len(past))
            shifted = jax.tree.map(partial(jnp.where, sample.taken), past[:-1], history)
            return jnp.where(calm, self.eta_most, eta), shifted

        eta, history = jax.lax.cond(self.redistributes, redistributed, lambda: (eta, history))
        # With zeros for the sample, nothing changes as soon as nothing is forgotten.
        factor = jnp.where(sample.taken, eta, 1.0)
        weight = jnp.where(self.weight_falls, (2 - eta) / 2, 1.0)
        normal = discounted(old, row, factor, weight)
        x, eta = jax.tree.map(
            partial(jnp.where, sample.taken), (solve_in_box(known, normal), eta), (x, last)
        )
        return ProgramRecursion(
            with_residual(normal, row, weight, x), history, samples + sample.taken, x, eta
        )


def _calm(u: Vector, past: History, low: Scalar, high: Scalar) -> Whether:
    """Whether every element of S lies in the critical interval.

    S = (mean X1 - mean X2)/(S1 + S2), X1 the information of the sample and the two matrices before
    it, X2 the three before these.
    """
    calm = jnp.ones((), dtype=bool)
    for six in zip(*map(jax.tree.leaves, (square(u), *past)), strict=True):
        first, first_std = _of_three(*six[:3])
        second, second_std = _of_three(*six[3:])
        difference, spread = first - second, first_std + second_std
        calm = calm & (difference > low * spread) & (difference < high * spread)
    return calm


def _of_three(a: Array, b: Array, c: Array) -> tuple[Array, Array]:
    """Mean and standard deviation of three scalars; an array of three would be slow in a batch."""
    mean = (a + b + c) / 3
    return mean, jnp.sqrt(((a - mean) ** 2 + (b - mean) ** 2 + (c - mean) ** 2) / 3)


def variant(
    weight_falls: bool, eta_least: float, eta_most: float, redistributes: bool
) -> QuadraticProgram:
    low, high, gain = -0.8, -0.7, 2.0
    numbers = (weight_falls, eta_least, eta_most, gain, redistributes, low, high)
    return QuadraticProgram(*numbers)


#: Algorithms 1 and 2. The gain and the critical interval are not printed.
qp_qian2024_1 = variant(True, 0.251, 1.0, True)
qp_qian2024_2 = variant(False, 0.971, 1.0, False)

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
    """Algorithm 2 without the bias of noise: (H - s^2 M) x = f + s^2 [sum w l, sum w l^2].

    With mu = mu_0 + n, U U' is too large by s^2 [l^2, l^3; l^3, l^4] on average and U Z too small
    by s^2 [l, l^2]. e = Z - U'x = D (mu_hat - mu), so the mean of e^2/D^2 estimates s^2.
    Source: Söderström 2007, Automatica 43:939-958 (bias-eliminating least squares), for this case.
    """

    RESETS = False

    eta_least: Scalar
    eta_most: Scalar
    gain: Scalar

    def initial(self, known: Known, key: PRNGKeyArray) -> CompensatedRecursion:
        noise, eta = NoiseSums(no_matrix(), *3 * [jnp.zeros(())]), jnp.asarray(self.eta_most)
        return CompensatedRecursion(no_samples(), noise, jnp.int32(0), start_of(known), eta)

    def found(self, known: Known, recursion: CompensatedRecursion) -> Found:
        normal, noise, samples, x, eta = recursion
        clear = compensated(normal, noise, variance(normal, noise))
        return Found(x.array(), covariance(clear), samples > 1, eta)

    def step(
        self, known: Known, recursion: CompensatedRecursion, sample: Sample
    ) -> CompensatedRecursion:
        row, size = regression(known, sample.slip, sample.adhesion), powers(jnp.abs(sample.slip))
        eta = forgetting(known, sample, recursion.x, self.eta_least, self.eta_most, self.gain)
        # With zeros for the sample, nothing changes as soon as nothing is forgotten.
        factor = jnp.where(sample.taken, eta, 1.0)
        normal = discounted(recursion.normal, row, factor, jnp.ones(()))
        old = recursion.noise
        noise = NoiseSums(
            factor * old.m + square(size),
            factor * old.f1 + size.a,
            factor * old.squares,  # the residual of this sample is added below, once x is known
            factor * old.weights + sample.taken,
        )
        s2 = variance(normal, noise)
        clear = compensated(normal, noise, s2)
        x, eta = jax.tree.map(
            partial(jnp.where, sample.taken),
            (solve_in_box(known, clear), eta),
            (recursion.x, recursion.eta),
        )
        error, d = row.z - row.u.dot(x), 1 + size.dot(x)
        noise = noise._replace(squares=noise.squares + (error / d) ** 2)
        # What the sample adds to the equation: U e + s^2 D [l, l^2] in place of U e alone.
        score = error * row.u + s2 * d * size
        normal = normal._replace(g=normal.g + square(score))
        return CompensatedRecursion(normal, noise, recursion.samples + sample.taken, x, eta)


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
