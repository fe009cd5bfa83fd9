"""Least squares on the linear form of Kiencke's curve, all samples at once."""

import jax.numpy as jnp
from jaxtyping import PRNGKeyArray

from adhesion_jax.identifiers.base import Estimate, Identifier, needs_blocks
from adhesion_jax.identifiers.curve_fit import Fit, FitState, residual, start, without_past
from adhesion_jax.identifiers.kiencke_linear import (
    Normal,
    covariance,
    needs_kiencke,
    regression,
    solve,
)
from adhesion_jax.records import Known, Record


class LinearLeastSquares(Identifier):
    """x = (sum U U')^-1 sum U Z, without bounds: the basis of every method of Qian et al. 2024.

    On a slippery rail p2 may come out negative; there is no peak then, and that is a failure.
    """

    FITS_LAST_RECORD = False
    RESETS = False

    def accepts(self, known: Known) -> str | None:
        return needs_blocks(known) or needs_kiencke(known)

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
        points = jnp.sum(record.mask, dtype=jnp.int32)
        squared = (z - x[0] * u1 - x[1] * u2) ** 2 * points / jnp.maximum(points - 2, 1)
        sums = sums._replace(
            g11=jnp.sum(squared * u1 * u1),
            g12=jnp.sum(squared * u1 * u2),
            g22=jnp.sum(squared * u2 * u2),
        )
        objective = jnp.sum(residual(known, record, x) ** 2)
        finite = jnp.isfinite(objective) & jnp.all(jnp.isfinite(x))
        fit = Fit(
            jnp.where(finite, x, state.fit.parameters),
            jnp.where(finite, covariance(sums), state.fit.covariance),
            objective,
            jnp.int32(1),
            finite,
            finite,
            jnp.where(finite, 0, points),
        )
        return state._replace(fit=fit)

    def estimate(self, state: FitState) -> Estimate:
        return without_past(state)
