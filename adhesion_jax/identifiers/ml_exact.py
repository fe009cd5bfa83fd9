"""Exact maximum likelihood for Burckhardt's curve, of a block or of all since the rail changed."""

from operator import itemgetter
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import betainc
from jaxtyping import Array, Float, PRNGKeyArray

from adhesion_jax.curves import Scalar, free_values
from adhesion_jax.curves.burckhardt import Burckhardt
from adhesion_jax.identifiers.base import Estimate, Identifier, as_arrays, needs_blocks
from adhesion_jax.identifiers.curve_fit import (
    Fit,
    FitState,
    OfLastRecord,
    judge,
    residual,
    to_estimate,
)
from adhesion_jax.metrics.information import inverse_information
from adhesion_jax.optim import variable_projection
from adhesion_jax.optim.arrays import Count, Value, Whether
from adhesion_jax.optim.least_squares import Result
from adhesion_jax.optim.variable_projection import Jet, Solution, Sums, summarise
from adhesion_jax.records import Known, Record

#: A box of c2 is too wide where the series of an exponential, at most 1, err by more than this.
_MOST_ERROR = 1e-6


def needs_burckhardt(known: Known) -> str | None:
    """None, or the reason why what is known does not have this form."""
    curve = known.curve
    if known.by_sample:
        return needs_blocks(known)
    if type(curve) is Burckhardt and curve.free == ("c1", "c2", "c3"):
        return _too_wide(known)
    return "it is written for Burckhardt's curve with c1, c2 and c3 unknown"


def _too_wide(known: Known) -> str | None:
    """None, or the reason why the series in c2 do not carry the box: phi^2 has exp(-2 c2 |l|)."""
    low, high, limit = float(known.lower[1]), float(known.upper[1]), float(known.slip_limit)
    x = np.geomspace(1 / high, 2 * limit, 100)
    error = variable_projection.series_error(lambda c2: np.exp(-c2[:, None] * x), low, high)
    if error <= _MOST_ERROR:
        return None
    return (
        f"its series are not exact for all c2 from {low:g} to {high:g} and slips up to {limit:g}; "
        "give c2 a smaller range"
    )


def burckhardt_sums(known: Known, record: Record) -> Sums:
    """The sums of c1 phi + c3 psi, phi = 1 - exp(-c2 |l|) (odd) and psi = -l, for all c2."""
    sign = jnp.sign(record.slip)

    def phi(c2: Float[Array, "degree 1"]) -> Float[Array, "degree points"]:
        return sign * (1 - jnp.exp(-c2 * jnp.abs(record.slip)))

    return summarise(
        phi,
        -record.slip,
        record.adhesion,
        record.mask,
        jnp.asarray(known.lower[1]),
        jnp.asarray(known.upper[1]),
    )


def burckhardt_information(sums: Sums, found: Solution) -> Float[Array, "3 3"]:
    """J'J over all the points behind the sums, J = [phi, c1 phi', psi], phi' = d phi/d c2.

    Of phi = 1 - exp(-c2 x) and psi = -x (x the size of slip) the sums hold enough: with
    d2/dc2^2 sum phi^2 = sum (4 x^2 exp(-2 c2 x) - 2 x^2 exp(-c2 x)) and
    d/dc2 sum phi psi = -sum x^2 exp(-c2 x), sum phi'^2 = sum x^2 exp(-2 c2 x) is a quarter of
    the first less twice the second.
    """
    c1, phi_phi, phi_psi = found.a, found.phi_phi, found.phi_psi
    steep = 0.25 * (phi_phi.bend - 2 * phi_psi.slope)
    across, down = 0.5 * c1 * phi_phi.slope, c1 * phi_psi.slope
    return jnp.array(
        [
            [phi_phi.value, across, phi_psi.value],
            [across, c1**2 * steep, down],
            [phi_psi.value, down, sums.psi_psi],
        ]
    )


class ExactMaximumLikelihood(OfLastRecord):
    """The least squares optimum over the box, which for Gaussian noise is the most likely curve.

    Linear in c1 and c3, so a search over c2 alone finds the global optimum. It is the reference:
    no other method can have a lower objective (He et al. 2018, Eq. 13, whose Eq. 14 prints
    arg max for arg min).
    """

    FITS_LAST_RECORD = True

    def accepts(self, known: Known) -> str | None:
        return needs_burckhardt(known)

    def update(self, state: FitState, record: Record) -> FitState:
        known = state.known
        sums = burckhardt_sums(known, record)
        found = variable_projection.minimise(sums, known.lower, known.upper)
        # Objective and information come from the sums too: no second pass over the points.
        best = Result(
            jnp.stack([found.a, found.nu, found.b]),
            jnp.maximum(found.objective, 0.0),
            burckhardt_information(sums, found),
            found.evaluations,
            found.evaluations,
            found.converged,
        )
        return state._replace(fit=judge(record, state.fit, best))


_PARAMETERS = 3

#: If the squared residuals add up to less than this share of the squared adhesion, they are due to
#: rounding in the sums.
_ROUNDING = 1e-12


class PooledPoints(NamedTuple):
    """The points since the last reset: their sums, their number and their optimum."""

    sums: Sums
    points: Value
    found: Solution


class PooledState(NamedTuple):
    """The pool, and the quantities of the last record that an estimate reports."""

    known: Known
    pool: PooledPoints
    objective: Value  # sum of squared residuals
    finite: Whether
    reset: Whether
    skipped: Count


def penalty(joint: Value, apart: Value, yy: Value, points: Value) -> Value:
    """(J_joint - J_apart)/s^2, s^2 = J_apart/(n - 6): the penalty of one curve for two data sets.

    J_apart is the sum of the optima of either set alone. If one curve holds for both, the
    penalty is distributed as chi-square with 3 degrees of freedom for large n, and a third of it
    nearly as F(3, n - 6). For data without noise, s^2 is that of rounding.
    """
    freedom = jnp.maximum(points - 2 * _PARAMETERS, 1.0)
    return (joint - apart) * freedom / jnp.maximum(apart, _ROUNDING * yy)


def chance(penalty: Value, points: Value) -> Value:
    """The probability of a larger penalty on an unchanged rail, by F(3, n - 6)."""
    freedom = jnp.maximum(points - 2 * _PARAMETERS, 1.0)
    share = freedom / (freedom + jnp.maximum(penalty, 0.0))
    return betainc(freedom / 2, jnp.asarray(_PARAMETERS / 2), share)


class PooledMaximumLikelihood(Identifier):
    """The most likely curve for a pool of points that grows until the rail has changed.

    A new block is fitted alone and together with the pool. Where a penalty as large as that of
    the joint fit has a probability below `level` on one rail (a generalised likelihood ratio
    test, of chi-square 21.1 for the usual level and many points), the pool is given up and
    begins anew with the block. The rail is taken as constant within a block.
    """

    FITS_LAST_RECORD = False
    POOLS = True
    RESETS = True

    level: Scalar = 1e-4

    def accepts(self, known: Known) -> str | None:
        return needs_burckhardt(known)

    def init(self, known: Known, key: PRNGKeyArray) -> PooledState:
        zero = jnp.zeros(())
        series = jnp.zeros(variable_projection.DEGREE)
        empty = Sums(zero, zero, zero, series, series, series)
        c1, c2, c3 = free_values(known.curve)
        none = Jet(zero, zero, zero)
        no = jnp.zeros((), dtype=bool)
        pool = PooledPoints(empty, zero, Solution(c1, c3, c2, zero, none, none, jnp.int32(0), no))
        return as_arrays(PooledState(known, pool, zero, ~no, no, jnp.int32(0)))

    def update(self, state: PooledState, record: Record) -> PooledState:
        """Only fresh points enter the pool, so that blocks may overlap."""
        known, pool = state.known, state.pool
        sums = burckhardt_sums(known, record._replace(mask=record.fresh))
        points = jnp.sum(record.fresh, dtype=float)
        both = jax.tree.map(jnp.add, pool.sums, sums)
        count = pool.points + points
        # The search, a long program, is called in a loop of two so that it is compiled once.
        found = jax.lax.map(
            lambda sums: variable_projection.minimise(sums, known.lower, known.upper),
            jax.tree.map(lambda *x: jnp.stack(x), sums, both),
        )
        found = found._replace(evaluations=jnp.full(2, jnp.sum(found.evaluations, dtype=jnp.int32)))
        alone, joint = (jax.tree.map(itemgetter(i), found) for i in range(2))
        cost = penalty(joint.objective, pool.found.objective + alone.objective, both.yy, count)
        # A curve passes through any three points, so that as few cannot contradict another curve.
        comparable = jnp.minimum(pool.points, points) > _PARAMETERS
        changed = comparable & (chance(cost, count) < self.level)
        grown, new = PooledPoints(both, count, joint), PooledPoints(sums, points, alone)
        after = jax.tree.map(lambda a, b: jnp.where(changed, a, b), new, grown)
        # A block that is not finite is left out, because it would stay in the sums of the pool. An
        # empty block, which may be the first, is left out too: it has no unique optimum.
        finite = jnp.isfinite(joint.objective)
        after = jax.tree.map(lambda a, b: jnp.where(finite & (points > 0), a, b), after, pool)
        misfit = residual(known, record, _parameters(after))
        return PooledState(
            known,
            after,
            jnp.sum(misfit**2),
            finite,
            finite & changed,
            jnp.where(finite, 0, jnp.sum(record.fresh, dtype=jnp.int32)),
        )

    def estimate(self, state: PooledState) -> Estimate:
        """The optimum of the pool with its covariance."""
        pool, parameters = state.pool, _parameters(state.pool)
        variance = pool.found.objective / jnp.maximum(pool.points - _PARAMETERS, 1.0)
        information = burckhardt_information(pool.sums, pool.found)
        fit = Fit(
            parameters,
            jnp.maximum(variance, 0.0) * inverse_information(information),
            state.objective,
            pool.found.evaluations,
            pool.found.converged & (pool.points >= _PARAMETERS),
            state.finite,
            state.skipped,
        )
        return to_estimate(state.known, fit, jnp.ones(()), state.reset)


def _parameters(pool: PooledPoints) -> Float[Array, "3"]:
    """c1, c2 and c3."""
    return jnp.stack([pool.found.a, pool.found.nu, pool.found.b])
