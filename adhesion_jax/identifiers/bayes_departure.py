"""A family of curves with a smooth departure, under noise with a memory, all weighed by Bayes."""

from collections import OrderedDict
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from adhesion_jax.identifiers.base import Estimate, Identifier, Status, as_arrays
from adhesion_jax.identifiers.online import LARGEST
from adhesion_jax.metrics.information import quantity_names
from adhesion_jax.optim.arrays import Count, Value, Whether
from adhesion_jax.records import Known, Record

#: Steepness c2 of the rise, by factors of 1.23.
STEEP = np.geomspace(8.0, 400.0, 20)

#: Standard deviations of the departure, in units of that of the noise; 0 would have no inverse.
SIZES = np.array([1e-6, 0.3, 1.0, 3.0, 10.0, 30.0])

#: Correlations of neighbours in the noise.
MEMORIES = np.array([0.0, 0.4, 0.7, 0.85, 0.9, 0.95])

#: Number of functions that the departure is made of.
FUNCTIONS = 14

#: The departure is smooth in u = log(1 + slip/_RISE), over lengths of _LENGTH.
_RISE, _LENGTH = 0.002, 0.8

#: Largest slip that the functions are made for.
_WIDEST = 1.0

#: Points that carry the functions, and points up to the largest slip where a peak is looked for.
_NODES, _PLACES = 64, 48

#: Prior standard deviation of c1 and c3, in units of that of the part of the noise which is new in
#: a sample: none that matters.
WIDE = 1e5

#: A block of this many points or fewer tells no variance beside the two parameters of a member.
_FEWEST = 3

#: The column of slip among the features.
_LINE = len(STEEP)

#: Sums of squares below this share of the adhesion's are due to rounding.
_ROUNDING = 1e-13


def _leading() -> tuple[np.ndarray, np.ndarray]:
    """Nodes in u, and what makes the leading functions of the kernels at them."""
    u = np.linspace(0.0, np.log1p(_WIDEST / _RISE), _NODES)
    near = np.exp(-0.5 * ((u[:, None] - u) / _LENGTH) ** 2)
    values, vectors = np.linalg.eigh(near - near[:, :1] * near[:1])
    return u, vectors[:, -FUNCTIONS:] / np.sqrt(values[-FUNCTIONS:])


_U, _LEADING = _leading()


def features(size: Value) -> Float[Array, " columns"]:
    """1 - exp(-c2 l) for each c2, -l, and the functions of the departure, at the slip l.

    These are the leading eigenfunctions of exp(-(u - v)^2/(2 _LENGTH^2)), conditioned to be 0 at
    slip 0, times the roots of their eigenvalues: coefficients of variance 1 make that process.
    """
    u = jnp.log1p(size / _RISE)

    def near(other: Array) -> Array:
        return jnp.exp(-0.5 * ((u - other) / _LENGTH) ** 2)

    kernel = near(jnp.asarray(_U)) - near(jnp.zeros(())) * np.exp(-0.5 * (_U / _LENGTH) ** 2)
    return jnp.concatenate([-jnp.expm1(-STEEP * size), -size[None], kernel @ _LEADING])


class Sums(NamedTuple):
    """Of rows (features, adhesion) with their time, all that a whitened regression needs.

    With noise of the correlation r the whitened rows are y(k) - r y(k-1), and first
    sqrt(1 - r^2) y(1): their products are a polynomial in r.
    """

    same: Float[Array, "all all"]  # sum y(k) y(k)'
    next: Float[Array, "all all"]  # sum y(k) y(k-1)'
    first: Float[Array, " all"]
    last: Float[Array, " all"]
    points: Value
    largest: Value  # slip


def summed(record: Record) -> Sums:
    """The sums of a record whose points come first, in one product."""
    size = jnp.where(record.mask, jnp.abs(record.slip), 0.0)
    adhesion = jnp.where(record.mask, jnp.sign(record.slip) * record.adhesion, 0.0)
    rows = jnp.concatenate([jax.vmap(features)(size), adhesion[:, None]], axis=1)
    rows = jnp.where(record.mask[:, None], rows, 0.0)
    points = jnp.sum(record.mask)
    return Sums(
        rows.T @ rows,
        rows[1:].T @ rows[:-1],
        rows[0],
        rows[jnp.maximum(points - 1, 0)],
        points.astype(float),
        jnp.max(size),
    )


def joined(before: Sums, after: Sums) -> Sums:
    """Of two stretches of samples, one of which follows the other."""
    none = before.points == 0
    across = jnp.outer(after.first, before.last)  # 0 where either has no sample
    return Sums(
        before.same + after.same,
        before.next + after.next + across,
        jnp.where(none, after.first, before.first),
        jnp.where(after.points == 0, before.last, after.last),
        before.points + after.points,
        jnp.maximum(before.largest, after.largest),
    )


def usable(record: Record) -> Record:
    """The samples of a stretch that tell something of a curve, before the others."""
    possible = jnp.isfinite(record.slip) & (jnp.abs(record.adhesion) <= LARGEST)
    mask = record.mask & possible & (record.slip != 0)
    order = jnp.argsort(~mask, stable=True)
    slip, adhesion = (jnp.where(mask, one, 0.0)[order] for one in (record.slip, record.adhesion))
    return Record(slip, adhesion, mask[order], mask[order], {})


def whitened(sums: Sums, memory: Value) -> Float[Array, "all all"]:
    """The products of the whitened rows."""
    ends = jnp.outer(sums.first, sums.first) + jnp.outer(sums.last, sums.last)
    both = sums.next + sums.next.T
    return (1 + memory**2) * sums.same - memory * both - memory**2 * ends


class Members(NamedTuple):
    """[steep] of one size and memory, or [members] of all."""

    evidence: Float[Array, "*members"]  # logarithm, but for what all have in common
    peak: Float[Array, "*members"]
    slip: Float[Array, "*members"]
    of_peak: Float[Array, "*members"]  # variance
    of_slip: Float[Array, "*members"]
    variance: Float[Array, "*members"]  # of the noise


def members_of(
    sums: Sums, table: Float[Array, "places columns"], size: Value, memory: Value
) -> Members:
    """All c2 with a departure of this size, under noise with this memory.

    y = c1 phi + c3 psi + b'f + e, c1 and c3 ~ N(0, (s WIDE)^2), b ~ N(0, (s size)^2/(1 - r^2)), s^2
    the variance of what is new in e: with no prior for log s the evidence is
    |A|^-1/2 |A0|^1/2 (1 - r^2)^1/2 R^-n/2, R = y'y - y'X A^-1 X'y, A = X'X + A0. The departure is
    eliminated once for all c2, which leaves two unknowns for each. `table` has the features at the
    places where the peak is looked for.
    """
    products = whitened(sums, memory)
    new = 1 - memory**2  # the share of the variance of the noise that is new in a sample
    inner = slice(_LINE + 1, _LINE + 1 + FUNCTIONS)
    outer = np.r_[: _LINE + 1, -1]
    root = jnp.linalg.cholesky(products[inner, inner] + new / size**2 * jnp.eye(FUNCTIONS))
    beside = jnp.concatenate([products[inner, outer], jnp.eye(FUNCTIONS)], axis=1)
    solved = jax.scipy.linalg.solve_triangular(root, beside, lower=True)
    across, half = solved[:, : len(outer)], solved[:, len(outer) :]
    left = products[np.ix_(outer, outer)] - across.T @ across

    phi, y = np.arange(_LINE), _LINE + 1
    a, c = left[phi, phi] + WIDE**-2, left[_LINE, _LINE] + WIDE**-2
    b = left[phi, _LINE]
    determinant = a * c - b**2
    c1 = (c * left[phi, y] - b * left[_LINE, y]) / determinant
    c3 = (a * left[_LINE, y] - b * left[phi, y]) / determinant
    rest = left[y, y] - c1 * left[phi, y] - c3 * left[_LINE, y]
    rest = jnp.maximum(rest, _ROUNDING * products[-1, -1])
    widths = 2 * jnp.sum(jnp.log(jnp.diagonal(root))) + jnp.log(determinant)
    prior = FUNCTIONS * jnp.log(new / size**2) + jnp.log(new)
    evidence = 0.5 * (prior - widths - sums.points * jnp.log(rest))
    of_departure = half.T @ (across[:, y, None] - across[:, phi] * c1 - across[:, [_LINE]] * c3)
    heights = table[:, phi] * c1 + table[:, [_LINE]] * c3 + table[:, inner] @ of_departure

    def of_linear(rows: Float[Array, "steep columns"]) -> Float[Array, " steep"]:
        """x'A^-1 x for a row of features each."""
        part = rows[:, inner] @ half.T
        one = rows[phi, phi] - jnp.sum(part * across[:, phi].T, axis=1)
        other = rows[:, _LINE] - part @ across[:, _LINE]
        two = (c * one**2 - 2 * b * one * other + a * other**2) / determinant
        return jnp.sum(part**2, axis=1) + two

    best = jnp.argmax(heights, axis=0)
    middle = jnp.clip(best, 1, _PLACES - 2)
    places = -table[:, _LINE]
    (x0, x1, x2), (f0, f1, f2) = (
        [value[middle + step, *of] for step in (-1, 0, 1)]
        for value, of in ((places, ()), (heights, (phi,)))
    )
    # The parabola through the best place and its neighbours.
    rise, fall = (f1 - f0) / (x1 - x0), (f2 - f1) / (x2 - x1)
    bend = jnp.minimum(2 * (fall - rise) / (x2 - x0), -_ROUNDING)
    slip = jnp.clip((x0 + x1) / 2 - rise / bend, x0, x2)
    peak = f1 + (slip - x1) * (rise + (slip - x0) * bend / 2)
    slope = (table[middle + 1] - table[middle - 1]) / (x2 - x0)[:, None]
    variance = rest / jnp.maximum(sums.points - 2, 1)
    return Members(
        evidence,
        peak,
        slip,
        variance * of_linear(table[middle]),
        variance * of_linear(slope) / bend**2,
        variance,
    )


def members(sums: Sums) -> Members:
    """Of all sizes and memories."""
    places = sums.largest * jnp.linspace(0.0, 1.0, _PLACES) ** 2
    table = jax.vmap(features)(places)
    by_size = jax.vmap(members_of, (None, None, 0, None))
    by_memory = jax.vmap(by_size, (None, None, None, 0))
    found = by_memory(sums, table, jnp.asarray(SIZES), jnp.asarray(MEMORIES))
    return jax.tree.map(jnp.ravel, found)


class BayesState(NamedTuple):
    known: Known
    sums: Sums
    finite: Whether
    points: Count  # of the last block, or of the stream so far
    skipped: Count


class BayesDeparture(Identifier):
    """mu_max of a curve that nobody named, with an interval that counts what is not known of it.

    The curve is Burckhardt's plus a smooth departure from it, whose size is judged as the steepness
    and the correlation of the noise are: all combinations of `STEEP`, `SIZES` and `MEMORIES` are
    members, equally likely beforehand and weighed by their evidence, which is closed
    (`members_of`). Each has a peak, whose height has the variance of the curve there; the estimate
    is the mean of the mixture, with the variance within the members and between them. The peak is
    looked for up to the largest slip. A block is judged alone, a stream as a whole: what one sample
    adds to the sums is exact, and nothing is forgotten, so that the rail must stay. There are no
    parameters to report, so these are NaN; the objective is the mean of the members' sums of
    squares, made white.
    Source: Kennedy and O'Hagan 2001, J. R. Stat. Soc. B 63:425-464 (departure from a model);
    Zellner 1971, Bayesian Inference in Econometrics, sections 3.1 and 4.1.
    """

    FITS_LAST_RECORD = False
    RESETS = False
    KNOWS_MEMORY = True

    def accepts(self, known: Known) -> str | None:
        if known.curve.NEEDS or "mu_max" not in known.asked:
            return "it looks for the peak of a curve that depends on slip alone"
        return None

    def init(self, known: Known, key: PRNGKeyArray) -> BayesState:
        nothing = jnp.zeros((1,), dtype=bool)
        sums = summed(Record(jnp.zeros(1), jnp.zeros(1), nothing, nothing, {}))
        none = jnp.int32(0)
        return as_arrays(BayesState(known, sums, jnp.ones((), dtype=bool), none, none))

    def update(self, state: BayesState, record: Record) -> BayesState:
        """A block that is not finite is left out whole, of a stream the sample."""
        points = jnp.sum(record.mask, dtype=jnp.int32)
        if state.known.by_sample:
            clean = usable(record)
            still = jnp.sum(record.mask & (record.slip == 0), dtype=jnp.int32)
            taken = jnp.sum(clean.mask, dtype=jnp.int32)
            sums = joined(state.sums, summed(clean))
            skipped = points - taken - still
            return BayesState(state.known, sums, state.finite, state.points + taken, skipped)
        sums = summed(record)
        finite = jnp.isfinite(sums.same[-1, -1]) & jnp.isfinite(sums.largest)
        used = finite & (points > _FEWEST)
        sums = jax.tree.map(lambda new, old: jnp.where(used, new, old), sums, state.sums)
        return BayesState(state.known, sums, finite, points, jnp.where(finite, 0, points))

    def estimate(self, state: BayesState) -> Estimate:
        known, enough = state.known, state.sums.points > _FEWEST
        clean = jax.tree.map(lambda one: jnp.where(enough, one, jnp.ones_like(one)), state.sums)
        start, zero = known.curve.peak(known.conditions, known.slip_limit), jnp.zeros(())
        before = Members(zero, start.adhesion, start.slip, zero, zero, zero)
        of = jax.tree.map(lambda new, old: jnp.where(enough, new, old), members(clean), before)
        weight = jax.nn.softmax(of.evidence)
        peak, slip = weight @ of.peak, weight @ of.slip
        apart = jnp.stack([of.peak - peak, of.slip - slip])
        within = jnp.diag(jnp.stack([weight @ of.of_peak, weight @ of.of_slip]))
        covariance = within + (weight * apart) @ apart.T
        names = quantity_names(state.known.curve)
        free = len(names) - 2
        none = jnp.full(free, jnp.nan)
        status = jnp.select(
            [~state.finite, ~(peak > 0), state.points <= _FEWEST],
            [
                Status.NOT_FINITE.value,
                Status.INADMISSIBLE.value,
                Status.NOT_CONVERGED.value,
            ],
            Status.TRUSTED.value,
        )
        return Estimate(
            OrderedDict(zip(names, jnp.append(none, jnp.stack([peak, slip])), strict=True)),
            jnp.full((free + 2, free + 2), jnp.nan).at[free:, free:].set(covariance),
            status,
            jnp.maximum(state.sums.points - 2, 0.0) * (weight @ of.variance),
            jnp.zeros((), dtype=bool),
            jnp.asarray(jnp.nan),
            jnp.int32(of.evidence.size),
            state.skipped,
        )


bayes_departure = BayesDeparture()
