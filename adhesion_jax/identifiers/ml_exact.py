"""Exact maximum likelihood for Burckhardt's curve by variable projection."""

import jax.numpy as jnp

from adhesion_jax.identifiers.burckhardt_sums import (
    burckhardt_information,
    burckhardt_sums,
    needs_burckhardt,
)
from adhesion_jax.identifiers.curve_fit import FitState, OfLastRecord, judge
from adhesion_jax.optim import variable_projection
from adhesion_jax.optim.least_squares import Result
from adhesion_jax.records import Known, Record


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
