"""Recursive least squares with exponential forgetting on the linear form of Kiencke's curve."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from adhesion_jax.curves import Scalar, free_values
from adhesion_jax.identifiers.base import Estimate, Identifier
from adhesion_jax.identifiers.kiencke_linear import (
    Pair,
    after_record,
    forgetting,
    needs_kiencke,
    online_estimate,
    regression,
)
from adhesion_jax.identifiers.online import OnlineState, begin
from adhesion_jax.records import Known, Record

#: Standard deviation of the start in p1 and p2, in units of the residual.
_PRIOR = 1e5


class Recursion(NamedTuple):
    """The estimate, P = (sum w U U')^-1 and G = sum w^2 e^2 U U', w the discount."""

    x: Pair
    p11: Float[Array, ""]
    p12: Float[Array, ""]
    p22: Float[Array, ""]
    g11: Float[Array, ""]
    g12: Float[Array, ""]
    g22: Float[Array, ""]
    eta: Float[Array, ""]


class RecursiveLeastSquares(Identifier):
    """K = P U/(eta + U'P U), x <- x + K (Z - U'x), P <- (P - K U'P)/eta, without bounds.

    With gain 0 the forgetting factor is constant, `eta_most`; else it follows the error.
    Source: Ljung 1999, System Identification, section 11.2; eta as in Qian et al. 2024, Eq. 9.
    """

    FITS_LAST_RECORD = False
    RESETS = False

    eta_least: Scalar
    eta_most: Scalar
    gain: Scalar

    def accepts(self, known: Known) -> str | None:
        return needs_kiencke(known)

    def init(self, known: Known, key: PRNGKeyArray) -> OnlineState:
        zero, wide = jnp.zeros(()), jnp.asarray(_PRIOR**2)
        x1, x2 = free_values(known.curve)
        eta = jnp.asarray(self.eta_most)
        return begin(known, Recursion((x1, x2), wide, zero, wide, zero, zero, zero, eta))

    def update(self, state: OnlineState, record: Record) -> OnlineState:
        return after_record(self._step, state, record)

    def estimate(self, state: OnlineState) -> Estimate:
        _, p11, p12, p22, g11, g12, g22, eta = state.recursion
        p = jnp.array([[p11, p12], [p12, p22]])
        covariance = p @ jnp.array([[g11, g12], [g12, g22]]) @ p
        return online_estimate(state, covariance, jnp.ones((), dtype=bool), eta)

    def _step(
        self,
        known: Known,
        recursion: Recursion,
        taken: Bool[Array, ""],
        slip: Float[Array, ""],
        adhesion: Float[Array, ""],
    ) -> Recursion:
        (x1, x2), p11, p12, p22, g11, g12, g22, last = recursion
        u1, u2, z = regression(known, slip, adhesion)
        eta = forgetting(known, slip, adhesion, (x1, x2), self.eta_least, self.eta_most, self.gain)
        # With zeros for the sample, nothing changes as soon as nothing is forgotten.
        eta = jnp.where(taken, eta, 1.0)
        pu1, pu2 = p11 * u1 + p12 * u2, p12 * u1 + p22 * u2
        innovation = z - x1 * u1 - x2 * u2
        share = 1 / (eta + u1 * pu1 + u2 * pu2)
        gain1, gain2, weighted1, weighted2 = _gains(eta, share, innovation, u1, u2, pu1, pu2)
        growth = 1 / eta
        return Recursion(
            (x1 + gain1 * innovation, x2 + gain2 * innovation),
            (p11 - pu1 * gain1) * growth,
            (p12 - pu1 * gain2) * growth,
            (p22 - pu2 * gain2) * growth,
            eta**2 * g11 + weighted1 * u1,
            eta**2 * g12 + weighted1 * u2,
            eta**2 * g22 + weighted2 * u2,
            jnp.where(taken, eta, last),
        )


def _gains(
    eta: Float[Array, ""],
    share: Float[Array, ""],
    innovation: Float[Array, ""],
    u1: Float[Array, ""],
    u2: Float[Array, ""],
    pu1: Float[Array, ""],
    pu2: Float[Array, ""],
) -> tuple[Float[Array, ""], ...]:
    """K, and U times the square of the residual at the new x.

    That residual is the innovation times eta/(eta + U'P U).
    """
    squared = (innovation * eta * share) ** 2
    return pu1 * share, pu2 * share, squared * u1, squared * u2


rls_kiencke = RecursiveLeastSquares(0.99, 0.99, 0.0)
rls_kiencke_variable = RecursiveLeastSquares(0.9, 1.0, 2.0)
