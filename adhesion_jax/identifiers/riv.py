"""Refined instrumental variables on Kiencke's linear form: recursive, robust, with resets."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from adhesion_jax.curves import Scalar
from adhesion_jax.identifiers.base import Estimate
from adhesion_jax.identifiers.innovations import FINEST, followed_scale, huber_weight
from adhesion_jax.identifiers.kiencke_linear import (
    OnlineKiencke,
    online_estimate,
    regression,
    start_of,
)
from adhesion_jax.identifiers.online import OnlineState, Sample, begin
from adhesion_jax.identifiers.pairs import Vector, square
from adhesion_jax.identifiers.young import (
    InstrumentSums,
    LatestSamples,
    along,
    curve_at,
    grown_older,
    inverse,
    is_new,
    no_latest,
    no_sums,
    refitted,
    solution,
    voted,
)
from adhesion_jax.optim.arrays import Count, Value, Whether
from adhesion_jax.records import Known, Record


class InstrumentsRecursion(NamedTuple):
    kept: LatestSamples
    sums: InstrumentSums
    x: Vector
    scale: Value
    samples: Count
    age: Count  # samples since the reset, the voters of the slow rule counted in
    reset: Whether  # whether there was one in the last record


class RefinedInstruments(OnlineKiencke):
    """(sum w zeta U') x = sum w zeta Z with zeta = mu_hat [l, l^2]/D^2, D = 1 + p1 l + p2 l^2.

    As Z - U'x = D (mu_hat - mu), the solution that agrees with its own instruments makes
    sum w r d mu_hat/d p zero, r = mu - mu_hat: it is the nonlinear fit, and the instruments,
    free of the noise of their sample, leave no bias. The weights are Huber's, min(1, huber/|nu|),
    nu = r over its standard deviation. While the estimate is young it is iterated on the samples
    kept; afterwards each sample is weighed once, with the estimate before it. When the votes of
    the last samples say that the curve has changed, only the voters are kept.

    Samples that tell nothing are passed over (`is_new`).
    Source: Young 2011, Recursive Estimation and Time-Series Analysis, chapter 7; Huber 1981,
    Robust Statistics, sections 7.6 (covariance) and 5.1 (median deviation).
    """

    RESETS = True

    huber: Scalar
    gain: Scalar  # least gain of the scale
    prior: Scalar  # standard deviation of the start, as a share of the box

    def init(self, known: Known, key: PRNGKeyArray) -> OnlineState:
        none, no = jnp.int32(0), jnp.zeros((), dtype=bool)
        start = no_latest(), no_sums(), start_of(known), jnp.asarray(FINEST)
        return begin(known, InstrumentsRecursion(*start, none, none, no))

    def update(self, state: OnlineState, record: Record) -> OnlineState:
        recursion = state.recursion._replace(reset=jnp.zeros((), dtype=bool))
        return super().update(state._replace(recursion=recursion), record)

    def estimate(self, state: OnlineState) -> Estimate:
        sums, reset = state.recursion.sums, state.recursion.reset
        return online_estimate(state, _covariance(sums), sums.number > 2, jnp.ones(()), reset)

    def step(
        self, known: Known, recursion: InstrumentsRecursion, sample: Sample
    ) -> InstrumentsRecursion:
        taken, slip, adhesion, _ = sample
        size, adhesion = jnp.abs(slip), jnp.where(slip < 0, -adhesion, adhesion)
        taken = taken & is_new(recursion.kept, size, adhesion)
        after = self._after(known, recursion, size, adhesion)
        return jax.tree.map(lambda new, old: jnp.where(taken, new, old), after, recursion)

    def _after(
        self, known: Known, recursion: InstrumentsRecursion, size: Value, adhesion: Value
    ) -> InstrumentsRecursion:
        sums, x, nu = self._taken_up(known, recursion, size, adhesion)
        kept, reset = voted(recursion.kept, recursion.samples, size, adhesion, nu)
        samples = recursion.samples + 1
        age = grown_older(recursion.age, reset)
        # Noise comes from the sensor and not from the rail, so its scale is kept at a reset.
        scale = followed_scale(recursion.scale, nu, samples, self.gain)
        x, sums, scale = refitted(
            known, kept, x, sums, scale, samples, age, reset, self.huber, self.prior
        )
        return InstrumentsRecursion(kept, sums, x, scale, samples, age, recursion.reset | reset)

    def _taken_up(
        self, known: Known, recursion: InstrumentsRecursion, size: Value, adhesion: Value
    ) -> tuple[InstrumentSums, Vector, Value]:
        """The sums and x with one more sample, and its innovation in standard deviations."""
        old, x = recursion.sums, recursion.x
        d, model = curve_at(known, x, size)
        ray = along(size)
        slope = model * size / d  # of -d mu_hat/d p, along the ray
        # Variance of the prediction over that of the noise.
        leverage = jnp.maximum(slope**2 * ray.dot(inverse(old).times(ray)), 0.0)
        residual = adhesion - model
        nu = residual / (recursion.scale * jnp.sqrt(1 + leverage))
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
        return sums, solution(known, sums), nu


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
