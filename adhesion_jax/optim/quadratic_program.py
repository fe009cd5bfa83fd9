"""The convex quadratic program in two unknowns over a rectangle, solved exactly."""

import jax.numpy as jnp
from jaxtyping import Array


def bounded_pair(
    y_phi: Array,
    y_psi: Array,
    phi_phi: Array,
    psi_psi: Array,
    phi_psi: Array,
    a_range: tuple[Array, Array],
    b_range: tuple[Array, Array],
) -> tuple[Array, Array]:
    """The a and b that minimise |y - a phi - b psi|^2 from the six inner products.

    That is a^2 phi_phi + 2 a b phi_psi + b^2 psi_psi - 2 a y_phi - 2 b y_psi, smallest over the
    rectangle: in the interior, else on the best edge. Any shape, one problem an element.
    """
    determinant = phi_phi * psi_psi - phi_psi**2
    safe = jnp.where(determinant > 0, determinant, 1.0)
    a = (y_phi * psi_psi - y_psi * phi_psi) / safe
    b = (y_psi * phi_phi - y_phi * phi_psi) / safe
    inside = (
        (determinant > 0)
        & (a >= a_range[0])
        & (a <= a_range[1])
        & (b >= b_range[0])
        & (b <= b_range[1])
    )

    edges = [(jnp.clip((y_phi - b * phi_psi) / phi_phi, *a_range), b) for b in b_range]
    edges += [(a, jnp.clip((y_psi - a * phi_psi) / psi_psi, *b_range)) for a in a_range]
    best, best_a, best_b = jnp.full_like(a, jnp.inf), a, b
    for edge_a, edge_b in edges:
        value = edge_a * (edge_a * phi_phi + 2 * edge_b * phi_psi - 2 * y_phi)
        value = value + edge_b * (edge_b * psi_psi - 2 * y_psi)
        better = value < best
        best = jnp.where(better, value, best)
        best_a = jnp.where(better, edge_a, best_a)
        best_b = jnp.where(better, edge_b, best_b)
    return jnp.where(inside, a, best_a), jnp.where(inside, b, best_b)
