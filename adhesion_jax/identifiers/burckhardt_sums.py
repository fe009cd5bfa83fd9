"""Burckhardt's curve as a problem that is linear in c1 and c3 given c2."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.curves.burckhardt import Burckhardt
from adhesion_jax.identifiers.base import needs_blocks
from adhesion_jax.optim.variable_projection import Sums, summarise
from adhesion_jax.scenarios import Known, Record, Scenario


def needs_burckhardt(scenario: Scenario) -> str | None:
    """None, or the reason why the scenario does not have this form."""
    curve = scenario.known.curve
    if scenario.by_sample:
        return needs_blocks(scenario)
    if type(curve) is Burckhardt and curve.free == ("c1", "c2", "c3"):
        return None
    return "it is written for Burckhardt's curve with c1, c2 and c3 unknown"


def burckhardt_sums(known: Known, record: Record) -> Sums:
    """The sums of c1 phi + c3 psi, phi = 1 - exp(-c2 |l|) (odd) and psi = -l, for all c2."""
    sign = jnp.sign(record.slip)

    def phi(c2: Float[Array, "degree 1"]) -> Float[Array, "degree points"]:
        return sign * (1 - jnp.exp(-c2 * jnp.abs(record.slip)))

    return summarise(
        phi, -record.slip, record.adhesion, record.mask, known.lower[1], known.upper[1]
    )
