"""Burckhardt's curve as a problem that is linear in c1 and c3 given c2."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.curves.burckhardt import Burckhardt
from adhesion_jax.identifiers.base import needs_blocks
from adhesion_jax.optim.variable_projection import Solution, Sums, summarise
from adhesion_jax.records import Known, Record


def needs_burckhardt(known: Known) -> str | None:
    """None, or the reason why what is known does not have this form."""
    curve = known.curve
    if known.by_sample:
        return needs_blocks(known)
    if type(curve) is Burckhardt and curve.free == ("c1", "c2", "c3"):
        return None
    return "it is written for Burckhardt's curve with c1, c2 and c3 unknown"


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
