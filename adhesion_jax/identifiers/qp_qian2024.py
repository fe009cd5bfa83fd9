"""Qian et al. 2024: a quadratic program at every sample, with a time-varying forgetting factor."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, PRNGKeyArray

from adhesion_jax.curves import Scalar
from adhesion_jax.identifiers.base import Estimate, Flag
from adhesion_jax.identifiers.kiencke_linear import (
    Normal,
    OnlineKiencke,
    covariance,
    discounted,
    forgetting,
    no_samples,
    online_estimate,
    regression,
    solve_in_box,
    start_of,
    with_residual,
)
from adhesion_jax.identifiers.online import OnlineState, Sample, begin
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

    def init(self, known: Known, key: PRNGKeyArray) -> OnlineState:
        history, eta = 4 * (no_matrix(),), jnp.asarray(self.eta_most)
        x = start_of(known)
        return begin(known, ProgramRecursion(no_samples(), history, jnp.int32(0), x, eta))

    def estimate(self, state: OnlineState) -> Estimate:
        recursion = state.recursion
        return online_estimate(
            state, covariance(recursion.normal), recursion.samples > 1, recursion.eta
        )

    def step(self, known: Known, recursion: ProgramRecursion, sample: Sample) -> ProgramRecursion:
        taken, slip, adhesion, _ = sample
        row = regression(known, slip, adhesion)
        eta = forgetting(
            known, slip, adhesion, recursion.x, self.eta_least, self.eta_most, self.gain
        )
        old = recursion.normal
        past = (old.h, *recursion.history)

        def redistributed() -> tuple[Value, History]:
            calm = _calm(row.u, past, self.low, self.high) & (recursion.samples >= len(past))
            shifted = jax.tree.map(partial(jnp.where, taken), past[:-1], recursion.history)
            return jnp.where(calm, self.eta_most, eta), shifted

        def as_it_was() -> tuple[Value, History]:
            return eta, recursion.history

        eta, history = jax.lax.cond(self.redistributes, redistributed, as_it_was)
        # With zeros for the sample, nothing changes as soon as nothing is forgotten.
        factor = jnp.where(taken, eta, 1.0)
        weight = jnp.where(self.weight_falls, (2 - eta) / 2, 1.0)
        normal = discounted(old, row, factor, weight)
        x, eta = jax.tree.map(
            partial(jnp.where, taken),
            (solve_in_box(known, normal), eta),
            (recursion.x, recursion.eta),
        )
        normal = with_residual(normal, row, weight, x)
        return ProgramRecursion(normal, history, recursion.samples + taken, x, eta)


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
