"""Least squares on the linear form of Kiencke's curve, all samples at once."""

import jax
import jax.numpy as jnp

from adhesion_jax.identifiers.base import needs_blocks
from adhesion_jax.identifiers.curve_fit import Fit, FitState, OfLastRecord, residual
from adhesion_jax.identifiers.kiencke_linear import Normal, covariance, needs_kiencke, regression
from adhesion_jax.identifiers.pairs import square
from adhesion_jax.records import Known, Record


class LinearLeastSquares(OfLastRecord):
    """x = (sum U U')^-1 sum U Z, without bounds: the basis of every method of Qian et al. 2024.

    On a slippery rail p2 may come out negative; there is no peak then, and that is a failure.
    """

    FITS_LAST_RECORD = False

    def accepts(self, known: Known) -> str | None:
        return needs_blocks(known) or needs_kiencke(known)

    def update(self, state: FitState, record: Record) -> FitState:
        known = state.known
        u, z = jax.tree.map(
            lambda column: jnp.where(record.mask, column, 0.0),
            regression(known, record.slip, record.adhesion),
        )
        h, f = square(u).sum(), (z * u).sum()
        found = h.inverse().times(f)
        points = jnp.sum(record.mask, dtype=jnp.int32)
        squared = (z - u.dot(found)) ** 2 * points / jnp.maximum(points - 2, 1)
        sums, x = Normal(h, f, (squared * square(u)).sum()), found.array()
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
