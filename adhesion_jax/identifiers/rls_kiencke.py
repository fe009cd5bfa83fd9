"""Recursive least squares with exponential forgetting on the linear form of Kiencke's curve."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import PRNGKeyArray

from adhesion_jax.curves import Scalar
from adhesion_jax.identifiers.base import Estimate
from adhesion_jax.identifiers.kiencke_linear import (
    OnlineKiencke,
    forgetting,
    online_estimate,
    regression,
    start_of,
)
from adhesion_jax.identifiers.online import OnlineState, Sample, begin
from adhesion_jax.identifiers.pairs import Symmetric, Vector, no_matrix, square
from adhesion_jax.optim.arrays import Value
from adhesion_jax.records import Known

#: Standard deviation of the start in p1 and p2, in units of the residual.
_PRIOR = 1e5


class LeastSquaresRecursion(NamedTuple):
    """The estimate, P = (sum w U U')^-1 and G = sum w^2 e^2 U U', w the discount."""

    x: Vector
    p: Symmetric
    g: Symmetric
    eta: Value


class RecursiveLeastSquares(OnlineKiencke):
    """K = P U/(eta + U'P U), x <- x + K (Z - U'x), P <- (P - K U'P)/eta, without bounds.

    With gain 0 the forgetting factor is constant, `eta_most`; else it follows the error.
    Source: Ljung 1999, System Identification, section 11.2; eta as in Qian et al. 2024, Eq. 9.
    """

    RESETS = False

    eta_least: Scalar
    eta_most: Scalar
    gain: Scalar

    def init(self, known: Known, key: PRNGKeyArray) -> OnlineState:
        wide, zero = jnp.asarray(_PRIOR**2), jnp.zeros(())
        p, eta = Symmetric(wide, zero, wide), jnp.asarray(self.eta_most)
        return begin(known, LeastSquaresRecursion(start_of(known), p, no_matrix(), eta))

    def estimate(self, state: OnlineState) -> Estimate:
        _, p, g, eta = state.recursion
        covariance = p.array() @ g.array() @ p.array()
        return online_estimate(state, covariance, jnp.ones((), dtype=bool), eta)

    def step(
        self, known: Known, recursion: LeastSquaresRecursion, sample: Sample
    ) -> LeastSquaresRecursion:
        taken, slip, adhesion, _ = sample
        x, p, g, last = recursion
        u, z = regression(known, slip, adhesion)
        eta = forgetting(known, slip, adhesion, x, self.eta_least, self.eta_most, self.gain)
        # With zeros for the sample, nothing changes as soon as nothing is forgotten.
        eta = jnp.where(taken, eta, 1.0)
        pu, innovation = p.times(u), z - u.dot(x)
        share = 1 / (eta + u.dot(pu))
        # The residual at the new x is the innovation times eta/(eta + U'P U).
        squared = (innovation * eta * share) ** 2
        return LeastSquaresRecursion(
            x + share * innovation * pu,
            1 / eta * (p - share * square(pu)),
            eta**2 * g + squared * square(u),
            jnp.where(taken, eta, last),
        )


rls_kiencke = RecursiveLeastSquares(0.99, 0.99, 0.0)
rls_kiencke_variable = RecursiveLeastSquares(0.9, 1.0, 2.0)
