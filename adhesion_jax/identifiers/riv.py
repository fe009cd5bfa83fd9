"""Refined instrumental variables on Kiencke's linear form: recursive, robust, with resets."""

from typing import NamedTuple, cast

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from adhesion_jax.curves import Scalar, free_values
from adhesion_jax.curves.kiencke import Kiencke
from adhesion_jax.identifiers.base import Estimate, Identifier
from adhesion_jax.identifiers.kiencke_linear import (
    after_record,
    needs_kiencke,
    online_estimate,
    regression,
)
from adhesion_jax.identifiers.online import OnlineState, begin
from adhesion_jax.optim.quadratic_program import bounded_pair
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


class Kept(NamedTuple):
    """The last samples, the latest first."""

    size: Float[Array, " length"]  # |slip|
    adhesion: Float[Array, " length"]
    surprise: Float[Array, " length"]  # |nu|, or 0 where it is no vote
    used: Bool[Array, " length"]  # whether it came after the last reset, or was a vote for it


class Sums(NamedTuple):
    """Sum w zeta U' and sum w zeta Z with the prior, then sums that the covariance needs."""

    h11: Float[Array, ""]
    h12: Float[Array, ""]
    h22: Float[Array, ""]
    f1: Float[Array, ""]
    f2: Float[Array, ""]
    number: Float[Array, ""]
    weights: Float[Array, ""]
    unclipped: Float[Array, ""]
    squares: Float[Array, ""]  # sum (w r)^2, each r scaled to the variance of the noise


class Recursion(NamedTuple):
    kept: Kept
    sums: Sums
    x: Float[Array, "2"]
    scale: Float[Array, ""]
    samples: Int[Array, ""]
    age: Int[Array, ""]  # samples since the reset, the voters of the slow rule counted in
    reset: Bool[Array, ""]  # whether there was one in the last record


class RefinedInstruments(Identifier):
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

    FITS_LAST_RECORD = False
    RESETS = True

    huber: Scalar
    gain: Scalar  # least gain of the scale
    prior: Scalar  # standard deviation of the start, as a share of the box

    def accepts(self, known: Known) -> str | None:
        return needs_kiencke(known)

    def init(self, known: Known, key: PRNGKeyArray) -> OnlineState:
        empty, zero, none = jnp.zeros(LENGTH), jnp.zeros(()), jnp.int32(0)
        kept = Kept(empty, empty, empty, empty > 0)
        sums = Sums(*(zero for _ in Sums._fields))
        x, scale = free_values(known.curve), jnp.asarray(_FINEST)
        return begin(known, Recursion(kept, sums, x, scale, none, none, empty[0] > 0))

    def update(self, state: OnlineState, record: Record) -> OnlineState:
        recursion = state.recursion._replace(reset=jnp.zeros((), dtype=bool))
        return after_record(self._step, state._replace(recursion=recursion), record)

    def estimate(self, state: OnlineState) -> Estimate:
        sums, reset = state.recursion.sums, state.recursion.reset
        return online_estimate(state, _covariance(sums), sums.number > 2, jnp.ones(()), reset)

    def _step(
        self,
        known: Known,
        recursion: Recursion,
        taken: Bool[Array, ""],
        slip: Float[Array, ""],
        adhesion: Float[Array, ""],
    ) -> Recursion:
        size, adhesion = jnp.abs(slip), jnp.where(slip < 0, -adhesion, adhesion)
        last = recursion.kept
        repeats = (size == last.size[0]) & (adhesion == last.adhesion[0])
        taken = taken & (size > 0) & ~repeats
        after = self._after(known, recursion, size, adhesion)
        return jax.tree.map(lambda new, old: jnp.where(taken, new, old), after, recursion)

    def _after(
        self,
        known: Known,
        recursion: Recursion,
        size: Float[Array, ""],
        adhesion: Float[Array, ""],
    ) -> Recursion:
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
        return Recursion(kept, sums, x, scale, samples, age, recursion.reset | reset)

    def _taken_up(
        self,
        known: Known,
        recursion: Recursion,
        size: Float[Array, ""],
        adhesion: Float[Array, ""],
    ) -> tuple[Sums, Float[Array, "2"], Float[Array, ""]]:
        """The sums and x with one more sample, and its innovation in standard deviations."""
        old, x = recursion.sums, recursion.x
        d, model = _curve(known, x, size)
        g1 = model * size / d  # -d mu_hat/d p1
        i11, i12, i22 = _inverse(old)
        # Variance of the prediction over that of the noise.
        leverage = jnp.maximum(g1**2 * (i11 + 2 * i12 * size + i22 * size**2), 0.0)
        residual = adhesion - model
        nu = residual / (recursion.scale * jnp.sqrt(1 + leverage))
        weight = self._weight(nu)
        u1, u2, z = regression(known, size, adhesion)
        zeta1 = weight * g1 / d
        sums = Sums(
            old.h11 + zeta1 * u1,
            old.h12 + zeta1 * u2,
            old.h22 + zeta1 * size * u2,
            old.f1 + zeta1 * z,
            old.f2 + zeta1 * size * z,
            old.number + 1,
            old.weights + weight,
            old.unclipped + (weight == 1),
            old.squares + (weight * residual) ** 2 / (1 + leverage),
        )
        return sums, _solution(known, sums), nu

    def _refitted(
        self,
        known: Known,
        kept: Kept,
        x: Float[Array, "2"],
        sums: Sums,
        scale: Float[Array, ""],
        anew: Bool[Array, ""],
        first: Bool[Array, ""],
        passes: Int[Array, ""],
    ) -> tuple[Float[Array, "2"], Sums, Float[Array, ""]]:
        """x, sums and, where `first`, the scale after some passes over the samples kept.

        In a batch the passes are as many as the youngest of its runs needs.
        """
        size, adhesion, _, used = kept
        count = jnp.sum(used, dtype=float)
        u1, u2, z = regression(known, size, adhesion)
        precision = (self.prior * (known.upper - known.lower)) ** -2
        x0 = free_values(known.curve)
        largest = jnp.max(jnp.where(used, jnp.abs(adhesion), 0.0))

        def one_pass(
            number: Int[Array, ""], carry: tuple[Array, Sums, Array]
        ) -> tuple[Array, Sums, Array]:
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
            zeta1 = weight * jnp.where(linear, u1, model * size / d**2)
            prior = scale**2 * precision
            sums = Sums(
                jnp.sum(zeta1 * u1) + prior[0],
                jnp.sum(zeta1 * u2),
                jnp.sum(zeta1 * size * u2) + prior[1],
                jnp.sum(zeta1 * z) + prior[0] * x0[0],
                jnp.sum(zeta1 * size * z) + prior[1] * x0[1],
                count,
                jnp.sum(weight),
                jnp.sum(weight == 1, dtype=float),
                jnp.sum((weight * residual) ** 2),
            )
            return _solution(known, sums), sums, scale

        return jax.lax.fori_loop(0, passes, one_pass, (x, sums, scale))

    def _weight(self, nu: Float[Array, "*points"]) -> Float[Array, "*points"]:
        return jnp.where(jnp.abs(nu) > self.huber, self.huber / jnp.abs(nu), 1.0)


def _curve(
    known: Known, x: Float[Array, "2"], size: Float[Array, "*points"]
) -> tuple[Float[Array, "*points"], Float[Array, "*points"]]:
    """D and mu_hat."""
    d = 1 + x[0] * size + x[1] * size**2
    return d, cast(Kiencke, known.curve).a0 * size / d


def _voted(
    recursion: Recursion, size: Float[Array, ""], adhesion: Float[Array, ""], nu: Float[Array, ""]
) -> tuple[Kept, Bool[Array, ""]]:
    """The kept samples with the latest among them, and whether there is a reset.

    After a reset only the samples that voted for it are used.
    """
    surprise = jnp.where(recursion.samples < LENGTH, 0.0, jnp.abs(nu))
    latest = (size, adhesion, surprise, jnp.ones((), dtype=bool))
    kept = Kept(
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


def _median(values: Float[Array, " length"], used: Bool[Array, " length"]) -> Float[Array, ""]:
    """The median of the values that are used, of which there is at least one.

    By the number of values below each: over a batch that takes less time than a sort.
    """
    values = jnp.where(used, values, jnp.inf)
    below = jnp.sum(values[:, None] > values, axis=1)
    upto = jnp.sum(values[:, None] >= values, axis=1)
    count = jnp.sum(used)

    def in_order(place: Int[Array, ""]) -> Float[Array, ""]:
        return jnp.min(jnp.where((below <= place) & (place < upto), values, jnp.inf))

    return (in_order((count - 1) // 2) + in_order(count // 2)) / 2


def _solution(known: Known, sums: Sums) -> Float[Array, "2"]:
    """The solution in the box, as if the sums were those of least squares (h12 for h21)."""
    ranges = [(known.lower[i], known.upper[i]) for i in (0, 1)]
    return jnp.stack(bounded_pair(sums.f1, sums.f2, sums.h11, sums.h22, sums.h12, *ranges))


def _inverse(sums: Sums) -> tuple[Float[Array, ""], Float[Array, ""], Float[Array, ""]]:
    """Elements 11, 12 and 22 of the inverse of sum w zeta U'; 0 before the first sample."""
    determinant = sums.h11 * sums.h22 - sums.h12**2
    determinant = jnp.where(sums.number > 0, determinant, jnp.inf)
    return sums.h22 / determinant, -sums.h12 / determinant, sums.h11 / determinant


def _covariance(sums: Sums) -> Float[Array, "2 2"]:
    """Mean psi^2/(mean psi')^2 times the inverse information, psi = w r clipped by Huber.

    sum w zeta U' is the information times the mean weight; psi' is 1 where r is not clipped.
    """
    i11, i12, i22 = _inverse(sums)
    squared = sums.squares / jnp.maximum(sums.number - 2, 1)
    clipping = sums.weights * sums.number / jnp.maximum(sums.unclipped, 1) ** 2
    return squared * clipping * jnp.array([[i11, i12], [i12, i22]])


#: huber = 2 makes the root mean square error without outliers .5 % larger, and with three per cent
#: of them does as well as 1.5. gain = .02 lets the scale follow some fifty samples, so that its
#: standard error is 8 %. prior = .1: a deviation of a tenth of the box matters with a handful of
#: samples, or longer where p2 stays uncertain by hundreds (wet rail, ten times the noise).
riv = RefinedInstruments(2.0, 0.02, 0.1)
