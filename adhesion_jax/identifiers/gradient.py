"""Nonlinear least squares by a gradient solver, whichever library it comes from."""

import equinox as eqx
import jax.numpy as jnp

from adhesion_jax.identifiers.base import needs_blocks
from adhesion_jax.identifiers.curve_fit import FitState, OfLastRecord, judge, residual
from adhesion_jax.optim.least_squares import Solver
from adhesion_jax.records import Known, Record


class GradientLeastSquares(OfLastRecord):
    """Any curve, by the solver given: from the box centre, on later blocks from the last estimate.

    After a block on which the solver did not converge the next one starts from the centre again.
    """

    FITS_LAST_RECORD = True

    solver: Solver = eqx.field(static=True)
    steps: int = eqx.field(static=True)  # largest number; a batch takes as many as its slowest run

    def accepts(self, known: Known) -> str | None:
        return needs_blocks(known)

    def update(self, state: FitState, record: Record) -> FitState:
        known, previous = state.known, state.fit
        centre = 0.5 * (known.lower + known.upper)
        found = self.solver(
            lambda parameters: residual(known, record, parameters),
            jnp.where(previous.converged, previous.parameters, centre),
            known.lower,
            known.upper,
            self.steps,
        )
        return state._replace(fit=judge(record, previous, found))
