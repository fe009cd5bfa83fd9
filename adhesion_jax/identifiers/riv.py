"""Refined instrumental variables on Kiencke's linear form: recursive, robust, with resets."""

from typing import NamedTuple, cast

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from adhesion_jax.curves import Scalar
from adhesion_jax.curves.kiencke import Kiencke
from adhesion_jax.identifiers.base import Estimate
from adhesion_jax.identifiers.kiencke_linear import (
    OnlineKiencke,
    online_estimate,
    regression,
    start_of,
)
from adhesion_jax.identifiers.online import OnlineState, Sample, begin
from adhesion_jax.identifiers.pairs import Symmetric, Vector, no_matrix, no_vector, square
from adhesion_jax.optim.arrays import Count, Value, Whether
from adhesion_jax.optim.quadratic_program import Products, bounded_pair
from adhesion_jax.records import Known, Record

#: Number of latest samples that are kept. Until an estimate rests on this many it is fitted to all
#: of them again with every sample; after that it is close enough to the truth that the instruments
#: of a sample need not be computed a second time.
LENGTH = 40

#: Passes over the kept samples: without an estimate to begin with (the first pass is then ordinary
#: least squares), and with the estimate of the sample before, which differs by one sample.
_FROM_NOTHING, _FROM_ESTIMATE = 5, 2

#: An estimate that rests on fewer samples than this is not used to begin the next one.
_FEW = 10

#: (votes, samples, limit): a reset takes this many of this many latest samples whose innovation
#: exceeds this many of its standard deviations. The first rule finds a switch, the second one that
#: is too small for the first. With Gaussian noise either rule holds less than once in 10^9 samples;
#: with three per cent of outliers ten times as wide the first one holds twice in 10^6. The first
#: `LENGTH` samples of a run have no vote, because a scale from twenty residuals may be a third of
#: the true one; a switch among them is missed if it makes the residuals, and so the scale, large.
_FAST, _SLOW = (4, 5, 3.0), (8, 10, 2.2)

#: Median of |n| for a standard Gaussian n.
_MEDIAN = 0.6745

#: Step of the recursion for the logarithm of that median, of least variance: 1/(density of log |n|
#: at the median).
_STEP = 2.333

#: Least standard deviation of the noise, finer than any sensor of adhesion: data without noise
#: would otherwise bring the scale to zero, and residuals are divided by it.
_FINEST = 1e-9

#: With fewer than five samples two parameters leave too few residuals to tell their scale; until
#: then it is at least this share of the largest adhesion.
_SCALE_OF_ADHESION = 0.05


class LatestSamples(NamedTuple):
    """The last samples, the latest first."""

    size: Float[Array, " length"]  # |slip|
    adhesion: Float[Array, " length"]
    surprise: Float[Array, " length"]  # |nu|, or 0 where it is no vote
    used: Bool[Array, " length"]  # whether it came after the last reset, or was a vote for it


class InstrumentSums(NamedTuple):
    """Sum w zeta U' and sum w zeta Z with the prior, then sums that the covariance needs.

    zeta and U have one direction, [1, l], so that their product is symmetric.
    """

    h: Symmetric
    f: Vector
    number: Value
    weights: Value
    unclipped: Value
    squares: Value  # sum (w r)^2, each r scaled to the variance of the noise


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

    A sample at slip 0 is passed over: adhesion is 0 there whatever the curve, so a wheel at
    standstill would make the scale that of the sensor at rest and every sample after it a vote.
    So is one that repeats the slip and the adhesion of the sample before it to the last digit, as
    a signal does that has stopped: its noise is the same again and does not average out.
    Source: Young 2011, Recursive Estimation and Time-Series Analysis, chapter 7; Huber 1981,
    Robust Statistics, sections 7.6 (covariance) and 5.1 (median deviation).
    """

    RESETS = True

    huber: Scalar
    gain: Scalar  # least gain of the scale
    prior: Scalar  # standard deviation of the start, as a share of the box

    def init(self, known: Known, key: PRNGKeyArray) -> OnlineState:
        empty, zero, none = jnp.zeros(LENGTH), jnp.zeros(()), jnp.int32(0)
        kept = LatestSamples(empty, empty, empty, empty > 0)
        sums = InstrumentSums(no_matrix(), no_vector(), *4 * [zero])
        x, scale = start_of(known), jnp.asarray(_FINEST)
        return begin(known, InstrumentsRecursion(kept, sums, x, scale, none, none, empty[0] > 0))

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
        last = recursion.kept
        repeats = (size == last.size[0]) & (adhesion == last.adhesion[0])
        taken = taken & (size > 0) & ~repeats
        after = self._after(known, recursion, size, adhesion)
        return jax.tree.map(lambda new, old: jnp.where(taken, new, old), after, recursion)

    def _after(
        self, known: Known, recursion: InstrumentsRecursion, size: Value, adhesion: Value
    ) -> InstrumentsRecursion:
        sums, x, nu = self._taken_up(known, recursion, size, adhesion)
        kept, reset = _voted(recursion, size, adhesion, nu)

        samples = recursion.samples + 1
        age = jnp.where(reset, _SLOW[1], jnp.minimum(recursion.age + 1, LENGTH + 1))
        # Noise comes from the sensor and not from the rail, so its scale is kept at a reset.
        step = jnp.maximum(_STEP / samples, self.gain)
        factor = jnp.exp(step * jnp.where(jnp.abs(nu) > _MEDIAN, 0.5, -0.5))
        scale = jnp.maximum(recursion.scale * factor, _FINEST)

        anew = reset | (jnp.sum(kept.used) < _FEW)
        passes = jnp.where(anew, _FROM_NOTHING, jnp.where(age <= LENGTH, _FROM_ESTIMATE, 0))
        first = samples <= LENGTH
        x, sums, scale = self._refitted(known, kept, x, sums, scale, anew, first, passes)
        return InstrumentsRecursion(kept, sums, x, scale, samples, age, recursion.reset | reset)

    def _taken_up(
        self, known: Known, recursion: InstrumentsRecursion, size: Value, adhesion: Value
    ) -> tuple[InstrumentSums, Vector, Value]:
        """The sums and x with one more sample, and its innovation in standard deviations."""
        old, x = recursion.sums, recursion.x
        d, model = _curve(known, x, size)
        ray = _along(size)
        slope = model * size / d  # of -d mu_hat/d p, along the ray
        # Variance of the prediction over that of the noise.
        leverage = jnp.maximum(slope**2 * ray.dot(_inverse(old).times(ray)), 0.0)
        residual = adhesion - model
        nu = residual / (recursion.scale * jnp.sqrt(1 + leverage))
        weight = self._weight(nu)
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
        return sums, _solution(known, sums), nu

    def _refitted(
        self,
        known: Known,
        kept: LatestSamples,
        x: Vector,
        sums: InstrumentSums,
        scale: Value,
        anew: Whether,
        first: Whether,
        passes: Count,
    ) -> tuple[Vector, InstrumentSums, Value]:
        """x, sums and, where `first`, the scale after some passes over the samples kept.

        In a batch the passes are as many as the youngest of its runs needs.
        """
        size, adhesion, _, used = kept
        count = jnp.sum(used, dtype=float)
        u, z = regression(known, size, adhesion)
        ray, x0 = _along(size), start_of(known)
        precision = Vector(*(self.prior * (known.upper - known.lower)) ** -2)
        largest = jnp.max(jnp.where(used, jnp.abs(adhesion), 0.0))

        def one_pass(
            number: Count, carry: tuple[Vector, InstrumentSums, Array]
        ) -> tuple[Vector, InstrumentSums, Array]:
            x, _, scale = carry
            d, model = _curve(known, x, size)
            residual = adhesion - model
            # Two parameters have been fitted, which makes the residuals smaller than the noise.
            spread = jnp.sqrt(count / jnp.maximum(count - 2, 1)) / _MEDIAN
            deviation = spread * _median(jnp.abs(residual), used)
            deviation = jnp.where(
                count < 5, jnp.maximum(deviation, _SCALE_OF_ADHESION * largest), deviation
            )
            scale = jnp.where(first, jnp.maximum(deviation, _FINEST), scale)
            linear = anew & (number == 0)
            weight = jnp.where(used, jnp.where(linear, 1.0, self._weight(residual / scale)), 0.0)
            zeta = weight * jnp.where(linear, u.a, model * size / d**2)
            prior = scale**2 * precision
            sums = InstrumentSums(
                (zeta * u.a * square(ray)).sum() + Symmetric(prior.a, jnp.zeros(()), prior.b),
                (zeta * z * ray).sum() + Vector(prior.a * x0.a, prior.b * x0.b),
                count,
                jnp.sum(weight),
                jnp.sum(weight == 1, dtype=float),
                jnp.sum((weight * residual) ** 2),
            )
            return _solution(known, sums), sums, scale

        return jax.lax.fori_loop(0, passes, one_pass, (x, sums, scale))

    def _weight(self, nu: Float[Array, "*points"]) -> Float[Array, "*points"]:
        return jnp.where(jnp.abs(nu) > self.huber, self.huber / jnp.abs(nu), 1.0)


def _along(size: Float[Array, "*points"]) -> Vector:
    """The direction of the regressors and of the instruments of a sample."""
    return Vector(jnp.ones_like(size), size)


def _curve(
    known: Known, x: Vector, size: Float[Array, "*points"]
) -> tuple[Float[Array, "*points"], Float[Array, "*points"]]:
    """D and mu_hat."""
    d = 1 + x.a * size + x.b * size**2
    return d, cast(Kiencke, known.curve).a0 * size / d


def _voted(
    recursion: InstrumentsRecursion, size: Value, adhesion: Value, nu: Value
) -> tuple[LatestSamples, Whether]:
    """The kept samples with the latest among them, and whether there is a reset.

    After a reset only the samples that voted for it are used.
    """
    surprise = jnp.where(recursion.samples < LENGTH, 0.0, jnp.abs(nu))
    latest = (size, adhesion, surprise, jnp.ones((), dtype=bool))
    kept = LatestSamples(
        *(
            jnp.concatenate([new[None], old[:-1]])
            for new, old in zip(latest, recursion.kept, strict=True)
        )
    )
    place = jnp.arange(LENGTH)
    fast, slow = ((place < last) & (kept.surprise > limit) for _, last, limit in (_FAST, _SLOW))
    is_fast, is_slow = jnp.sum(fast) >= _FAST[0], jnp.sum(slow) >= _SLOW[0]
    reset = is_fast | is_slow
    return kept._replace(
        surprise=jnp.where(reset, 0.0, kept.surprise),  # a sample votes for one reset at most
        used=jnp.where(is_fast, fast, jnp.where(is_slow, slow, kept.used)),
    ), reset


def _median(values: Float[Array, " length"], used: Bool[Array, " length"]) -> Value:
    """The median of the values that are used, of which there is at least one.

    By the number of values below each: over a batch that takes less time than a sort.
    """
    values = jnp.where(used, values, jnp.inf)
    below = jnp.sum(values[:, None] > values, axis=1)
    upto = jnp.sum(values[:, None] >= values, axis=1)
    count = jnp.sum(used)

    def in_order(place: Count) -> Value:
        return jnp.min(jnp.where((below <= place) & (place < upto), values, jnp.inf))

    return (in_order((count - 1) // 2) + in_order(count // 2)) / 2


def _solution(known: Known, sums: InstrumentSums) -> Vector:
    """The solution in the box, as if the sums were those of least squares."""
    h, f = sums.h, sums.f
    ranges = ((known.lower[i], known.upper[i]) for i in (0, 1))
    return Vector(*bounded_pair(Products(f.a, f.b, h.a, h.c, h.b), *ranges))


def _inverse(sums: InstrumentSums) -> Symmetric:
    """The inverse of sum w zeta U'; 0 before the first sample."""
    h = sums.h
    determinant = jnp.where(sums.number > 0, h.determinant(), jnp.inf)
    return 1 / determinant * Symmetric(h.c, -h.b, h.a)


def _covariance(sums: InstrumentSums) -> Float[Array, "2 2"]:
    """Mean psi^2/(mean psi')^2 times the inverse information, psi = w r clipped by Huber.

    sum w zeta U' is the information times the mean weight; psi' is 1 where r is not clipped.
    """
    squared = sums.squares / jnp.maximum(sums.number - 2, 1)
    clipping = sums.weights * sums.number / jnp.maximum(sums.unclipped, 1) ** 2
    return squared * clipping * _inverse(sums).array()


#: huber = 2 makes the root mean square error without outliers .5 % larger, and with three per cent
#: of them does as well as 1.5. gain = .02 lets the scale follow some fifty samples, so that its
#: standard error is 8 %. prior = .1: a deviation of a tenth of the box matters with a handful of
#: samples, or longer where p2 stays uncertain by hundreds (wet rail, ten times the noise).
riv = RefinedInstruments(2.0, 0.02, 0.1)
