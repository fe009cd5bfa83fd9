"""Least squares on the linear form of Kiencke's curve, all samples at once."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import PRNGKeyArray

from adhesion_jax.identifiers.base import Estimate, Identifier, needs_blocks
from adhesion_jax.identifiers.curve_fit import FitState, start, to_estimate
from adhesion_jax.identifiers.kiencke_linear import (
    Normal,
    covariance,
    fitted,
    needs_kiencke,
    regression,
    solve,
)
from adhesion_jax.records import Known, Record
from adhesion_jax.scenarios import Scenario


class LinearLeastSquares(Identifier):
    """x = (sum U U')^-1 sum U Z, without bounds: what is behind every method of Qian et al. 2024.

    On a slippery rail p2 may come out negative; there is no peak then, and that is a failure.
    """

    fits_last_record: ClassVar[bool] = False

    def accepts(self, scenario: Scenario) -> str | None:
        return needs_blocks(scenario) or needs_kiencke(scenario)

    def init(self, known: Known, key: PRNGKeyArray) -> FitState:
        return start(known, key)

    def update(self, state: FitState, record: Record) -> FitState:
        known = state.known
        u1, u2, z = (
            jnp.where(record.mask, column, 0.0)
            for column in regression(known, record.slip, record.adhesion)
        )
        zero = jnp.zeros(())
        sums = Normal(
            jnp.sum(u1 * u1),
            jnp.sum(u1 * u2),
            jnp.sum(u2 * u2),
            jnp.sum(u1 * z),
            jnp.sum(u2 * z),
            zero,
            zero,
            zero,
        )
        x = solve(sums)
        points = jnp.sum(record.mask)
        squared = (z - x[0] * u1 - x[1] * u2) ** 2 * points / jnp.maximum(points - 2, 1)
        sums = sums._replace(
            g11=jnp.sum(squared * u1 * u1),
            g12=jnp.sum(squared * u1 * u2),
            g22=jnp.sum(squared * u2 * u2),
        )
        none, one, yes = jnp.asarray(jnp.nan), jnp.int32(1), jnp.ones((), dtype=bool)
        fit = fitted(known, record, state.fit, x, covariance(sums), none, one, yes)
        return state._replace(fit=fit)

    def estimate(self, state: FitState) -> Estimate:
        return to_estimate(state)
