"""Least squares on the linear form of Kiencke's curve, all samples at once and recursively."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import PRNGKeyArray

from adhesion_jax.curves import Scalar
from adhesion_jax.identifiers.base import needs_blocks
from adhesion_jax.identifiers.curve_fit import Fit, FitState, OfLastRecord, residual
from adhesion_jax.identifiers.kiencke_linear import (
    Normal,
    OnlineKiencke,
    covariance,
    forgetting,
    needs_kiencke,
    regression,
    start_of,
)
from adhesion_jax.identifiers.online import Found, Sample, SelectiveMethod
from adhesion_jax.identifiers.pairs import Symmetric, Vector, no_matrix, square
from adhesion_jax.optim.arrays import Value
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


#: Standard deviation of the start in p1 and p2, in units of the residual.
_PRIOR = 1e5


class LeastSquaresRecursion(NamedTuple):
    """The estimate, P = (sum w U U')^-1 and G = sum w^2 e^2 U U', w the discount."""

    x: Vector
    p: Symmetric
    g: Symmetric
    eta: Value


class RecursiveLeastSquares(SelectiveMethod, OnlineKiencke):
    """K = P U/(eta + U'P U), x <- x + K (Z - U'x), P <- (P - K U'P)/eta, without bounds.

    With gain 0 the forgetting factor is constant, `eta_most`; else it follows the error.
    Source: Ljung 1999, System Identification, section 11.2; eta as in Qian et al. 2024, Eq. 9.
    """

    RESETS = False

    eta_least: Scalar
    eta_most: Scalar
    gain: Scalar

    def initial(self, known: Known, key: PRNGKeyArray) -> LeastSquaresRecursion:
        wide, zero = jnp.asarray(_PRIOR**2), jnp.zeros(())
        p, eta = Symmetric(wide, zero, wide), jnp.asarray(self.eta_most)
        return LeastSquaresRecursion(start_of(known), p, no_matrix(), eta)

    def found(self, known: Known, recursion: LeastSquaresRecursion) -> Found:
        x, p, g, eta = recursion
        covariance = p.array() @ g.array() @ p.array()
        return Found(x.array(), covariance, jnp.ones((), dtype=bool), eta)

    def after(
        self, known: Known, recursion: LeastSquaresRecursion, sample: Sample
    ) -> LeastSquaresRecursion:
        x, p, g, _ = recursion
        u, z = regression(known, sample.slip, sample.adhesion)
        eta = forgetting(known, sample, x, self.eta_least, self.eta_most, self.gain)
        pu, innovation = p.times(u), z - u.dot(x)
        share = 1 / (eta + u.dot(pu))
        # The residual at the new x is the innovation times eta/(eta + U'P U).
        squared = (innovation * eta * share) ** 2
        return LeastSquaresRecursion(
            x + share * innovation * pu,
            1 / eta * (p - share * square(pu)),
            eta**2 * g + squared * square(u),
            eta,
        )


rls_kiencke = RecursiveLeastSquares(0.99, 0.99, 0.0)
rls_kiencke_variable = RecursiveLeastSquares(0.9, 1.0, 2.0)
