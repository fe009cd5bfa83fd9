"""An estimate of Kiencke's curve from the latest samples, and the votes that begin it anew."""

from dataclasses import replace
from typing import Any, NamedTuple, TypeVar, cast

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from adhesion_jax.curves import Scalar
from adhesion_jax.curves.kiencke import Kiencke
from adhesion_jax.identifiers.innovations import FINEST, MEDIAN, SLOW, huber_weight, votes
from adhesion_jax.identifiers.kiencke_linear import OnlineKiencke, regression, start_of
from adhesion_jax.identifiers.online import Sample, SelectiveMethod
from adhesion_jax.identifiers.pairs import Symmetric, Vector, no_matrix, no_vector, square
from adhesion_jax.optim.arrays import Count, Value, Whether
from adhesion_jax.optim.quadratic_program import Products, bounded_pair
from adhesion_jax.records import Known

#: Number of latest samples that are kept. Until an estimate rests on this many it is fitted to all
#: of them again with every sample; after that it is close enough to the truth that the instruments
#: of a sample need not be computed a second time.
LENGTH = 40

#: Passes over the kept samples: without an estimate to begin with (the first pass is then ordinary
#: least squares), and with the estimate of the sample before, which differs by one sample.
_FROM_NOTHING, _FROM_ESTIMATE = 5, 2

#: An estimate that rests on fewer samples than this is not used to begin the next one.
_FEW = 10

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


class Young(eqx.Module):
    """The latest samples, and the estimate that rests on them and on the sums."""

    x: Vector
    kept: LatestSamples
    sums: InstrumentSums
    scale: Value  # standard deviation of the noise
    samples: Count
    age: Count  # samples since the reset, the voters of the slow rule counted in
    reset: Whether  # whether there was one in the last record


Y = TypeVar("Y", bound=Young)


def at_the_start(known: Known) -> Young:
    """Before any."""
    empty, zero, none = jnp.zeros(LENGTH), jnp.zeros(()), jnp.int32(0)
    return Young(
        x=start_of(known),
        kept=LatestSamples(empty, empty, empty, empty > 0),
        sums=InstrumentSums(no_matrix(), no_vector(), zero, zero, zero, zero),
        scale=jnp.asarray(FINEST),
        samples=none,
        age=none,
        reset=jnp.zeros((), dtype=bool),
    )


class YoungKiencke(SelectiveMethod, OnlineKiencke):
    """A method that is young at first and after a reset; its recursion has the samples `kept`."""

    RESETS = True

    def tells(self, recursion: Any, sample: Sample) -> Whether:
        """Whether a sample tells anything.

        At slip 0 adhesion is 0 whatever the curve: a wheel at standstill would make the scale that
        of the sensor at rest, and every sample after it a vote. A sample that repeats the slip and
        the adhesion of the one before to the last digit is that of a signal that has stopped: its
        noise is the same again and does not average out.
        """
        kept: LatestSamples = recursion.kept
        repeats = (sample.slip == kept.size[0]) & (sample.adhesion == kept.adhesion[0])
        return (sample.slip > 0) & ~repeats


def along(size: Float[Array, "*points"]) -> Vector:
    """The direction of the regressors and of the instruments of a sample."""
    return Vector(jnp.ones_like(size), size)


def curve_at(
    known: Known, x: Vector, size: Float[Array, "*points"]
) -> tuple[Float[Array, "*points"], Float[Array, "*points"]]:
    """D and mu_hat."""
    d = 1 + x.a * size + x.b * size**2
    return d, cast(Kiencke, known.curve).a0 * size / d


def voted(young: Y, sample: Sample, nu: Value) -> tuple[Y, Whether]:
    """With one more sample, whose innovation is nu deviations, and whether there is a reset.

    After a reset only the samples that voted for it are used. The first `LENGTH` samples of a run
    have no vote, because a scale from twenty residuals may be a third of the true one; a switch
    among them is missed if it makes the residuals, and so the scale, large.
    """
    surprise = jnp.where(young.samples < LENGTH, 0.0, jnp.abs(nu))
    latest = (sample.slip, sample.adhesion, surprise, jnp.ones((), dtype=bool))
    pairs = zip(latest, young.kept, strict=True)
    kept = LatestSamples(*(jnp.concatenate([new[None], old[:-1]]) for new, old in pairs))
    voters, reset = votes(kept.surprise)
    kept = kept._replace(
        surprise=jnp.where(reset, 0.0, kept.surprise),  # a sample votes for one reset at most
        used=jnp.where(reset, voters, kept.used),
    )
    # Counted up to where the estimate is no longer young.
    age = jnp.where(reset, SLOW[1], jnp.minimum(young.age + 1, LENGTH + 1))
    samples = young.samples + 1
    return replace(young, kept=kept, samples=samples, age=age, reset=young.reset | reset), reset


def refitted(known: Known, young: Y, reset: Whether, huber: Scalar, prior: Scalar) -> Y:
    """With x, sums and scale after some passes over the samples kept: none where x is old.

    The scale is taken from them in the first `LENGTH` samples of a run. In a batch the passes are
    as many as the youngest of its runs needs.
    """
    size, adhesion, _, used = young.kept
    count = jnp.sum(used, dtype=float)
    anew = reset | (jnp.sum(used) < _FEW)
    passes = jnp.where(anew, _FROM_NOTHING, jnp.where(young.age <= LENGTH, _FROM_ESTIMATE, 0))
    first = young.samples <= LENGTH
    u, z = regression(known, size, adhesion)
    ray, x0 = along(size), start_of(known)
    precision = Vector(*(prior * (known.upper - known.lower)) ** -2)
    largest = jnp.max(jnp.where(used, jnp.abs(adhesion), 0.0))

    def one_pass(
        number: Count, carry: tuple[Vector, InstrumentSums, Array]
    ) -> tuple[Vector, InstrumentSums, Array]:
        x, _, scale = carry
        d, model = curve_at(known, x, size)
        residual = adhesion - model
        # Two parameters have been fitted, which makes the residuals smaller than the noise.
        spread = jnp.sqrt(count / jnp.maximum(count - 2, 1)) / MEDIAN
        deviation = spread * _median(jnp.abs(residual), used)
        deviation = jnp.where(
            count < 5, jnp.maximum(deviation, _SCALE_OF_ADHESION * largest), deviation
        )
        scale = jnp.where(first, jnp.maximum(deviation, FINEST), scale)
        linear = anew & (number == 0)
        weight = jnp.where(used, jnp.where(linear, 1.0, huber_weight(residual / scale, huber)), 0.0)
        zeta = weight * jnp.where(linear, u.a, model * size / d**2)
        pull = scale**2 * precision
        sums = InstrumentSums(
            (zeta * u.a * square(ray)).sum() + Symmetric(pull.a, jnp.zeros(()), pull.b),
            (zeta * z * ray).sum() + Vector(pull.a * x0.a, pull.b * x0.b),
            count,
            jnp.sum(weight),
            jnp.sum(weight == 1, dtype=float),
            jnp.sum((weight * residual) ** 2),
        )
        return solution(known, sums), sums, scale

    x, sums, scale = jax.lax.fori_loop(0, passes, one_pass, (young.x, young.sums, young.scale))
    return replace(young, x=x, sums=sums, scale=scale)


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


def solution(known: Known, sums: InstrumentSums) -> Vector:
    """The solution in the box, as if the sums were those of least squares."""
    h, f = sums.h, sums.f
    ranges = ((known.lower[i], known.upper[i]) for i in (0, 1))
    return Vector(*bounded_pair(Products(f.a, f.b, h.a, h.c, h.b), *ranges))


def inverse(sums: InstrumentSums) -> Symmetric:
    """The inverse of sum w zeta U'; 0 before the first sample."""
    h = sums.h
    determinant = jnp.where(sums.number > 0, h.determinant(), jnp.inf)
    return 1 / determinant * Symmetric(h.c, -h.b, h.a)
