"""Exact maximum likelihood over all blocks since the rail last changed."""

from operator import itemgetter
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.scipy.special import betainc
from jaxtyping import Array, Float, PRNGKeyArray

from adhesion_jax.identifiers.base import Estimate, Identifier
from adhesion_jax.identifiers.burckhardt_sums import (
    burckhardt_information,
    burckhardt_sums,
    needs_burckhardt,
)
from adhesion_jax.identifiers.curve_fit import Fit, FitState, residual, start, to_estimate
from adhesion_jax.metrics.information import inverse_information
from adhesion_jax.optim import variable_projection
from adhesion_jax.optim.variable_projection import Solution, Sums
from adhesion_jax.records import Known, Record
from adhesion_jax.scenarios import Scenario

_PARAMETERS = 3

#: Noise below this share of the adhesion (squared) is that of rounding in the sums.
_ROUNDING = 1e-12


class Pool(NamedTuple):
    """What is kept of the points since the last reset: their sums, number and optimum."""

    sums: Sums
    points: Float[Array, ""]
    found: Solution


class PooledState(NamedTuple):
    batch: FitState
    pool: Pool


def penalty(
    joint: Float[Array, ""],
    apart: Float[Array, ""],
    yy: Float[Array, ""],
    points: Float[Array, ""],
) -> Float[Array, ""]:
    """(J_joint - J_apart)/s^2, s^2 = J_apart/(n - 6): what one curve for two sets of data costs.

    J_apart is the sum of the optima of either set alone. If one curve holds for both, the
    penalty is distributed as chi-square with 3 degrees of freedom for large n, and a third of it
    nearly as F(3, n - 6). The noise of data without any is taken as that of rounding.
    """
    freedom = jnp.maximum(points - 2 * _PARAMETERS, 1.0)
    return (joint - apart) * freedom / jnp.maximum(apart, _ROUNDING * yy)


def chance(penalty: Float[Array, ""], points: Float[Array, ""]) -> Float[Array, ""]:
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

    fits_last_record: ClassVar[bool] = False

    level: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.asarray(1e-4))

    def accepts(self, scenario: Scenario) -> str | None:
        return needs_burckhardt(scenario)

    def init(self, known: Known, key: PRNGKeyArray) -> PooledState:
        zero = jnp.zeros(())
        series = jnp.zeros(variable_projection.DEGREE)
        empty = Sums(zero, zero, zero, series, series, series)
        return PooledState(start(known, key), Pool(empty, zero, Solution(zero, zero, zero, zero)))

    def update(self, state: PooledState, record: Record) -> PooledState:
        """Only fresh points enter the pool, so that blocks may overlap."""
        known, pool = state.batch.known, state.pool
        sums = burckhardt_sums(known, record._replace(mask=record.fresh))
        points = jnp.sum(record.fresh, dtype=float)
        both = jax.tree.map(jnp.add, pool.sums, sums)
        count = pool.points + points
        # In a loop of two, so that the search, a long program, is compiled once.
        found = jax.lax.map(
            lambda sums: variable_projection.minimise(sums, known.lower, known.upper),
            jax.tree.map(lambda *x: jnp.stack(x), sums, both),
        )
        alone, joint = (jax.tree.map(itemgetter(i), found) for i in range(2))
        cost = penalty(joint.objective, pool.found.objective + alone.objective, both.yy, count)
        # Three points or fewer are met by a curve of their own, and say nothing against another.
        comparable = jnp.minimum(pool.points, points) > _PARAMETERS
        changed = comparable & (chance(cost, count) < self.level)
        first = pool.points == 0
        grown, new = Pool(both, count, joint), Pool(sums, points, alone)
        after = jax.tree.map(lambda a, b: jnp.where(changed, a, b), new, grown)
        # A block that is not finite is left out, for it would never leave the pool again.
        finite = jnp.isfinite(joint.objective)
        after = jax.tree.map(lambda a, b: jnp.where(finite, a, b), after, pool)
        forgetting = jnp.where(finite & (changed | first), 0.0, 1.0)
        return PooledState(self._fitted(state.batch, record, after, forgetting, finite), after)

    def _fitted(
        self,
        batch: FitState,
        record: Record,
        pool: Pool,
        forgetting: Float[Array, ""],
        finite: Array,
    ) -> FitState:
        """The optimum of the pool with its covariance, and its misfit to the last record."""
        known, found = batch.known, pool.found
        parameters = jnp.stack([found.a, found.nu, found.b])
        parameters = jnp.where(finite, parameters, batch.fit.parameters)
        variance = found.objective / jnp.maximum(pool.points - _PARAMETERS, 1.0)
        information = burckhardt_information(pool.sums, known, parameters)
        fit = Fit(
            parameters,
            jnp.maximum(variance, 0.0) * inverse_information(information),
            jnp.sum(residual(known, record, parameters) ** 2),
            forgetting,
            jnp.int32(2 * variable_projection.EVALUATIONS),
            jnp.ones((), dtype=bool),
            finite,
        )
        return batch._replace(fit=fit)

    def estimate(self, state: PooledState) -> Estimate:
        return to_estimate(state.batch)
