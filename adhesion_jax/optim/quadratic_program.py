"""The convex quadratic program in two unknowns over a rectangle, solved exactly."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from adhesion_jax.optim.arrays import Whether

Range = tuple[Array, Array]


class Products(NamedTuple):
    """The inner products that |y - a phi - b psi|^2 depends on, |y|^2 apart."""

    y_phi: Array
    y_psi: Array
    phi_phi: Array
    psi_psi: Array
    phi_psi: Array


def bounded_pair(products: Products, a_range: Range, b_range: Range) -> tuple[Array, Array]:
    """The a and b that minimise |y - a phi - b psi|^2 from the inner products.

    That is a^2 phi_phi + 2 a b phi_psi + b^2 psi_psi - 2 a y_phi - 2 b y_psi, smallest over the
    rectangle: in the interior, else on the best edge. Any shape, one problem an element.
    """
    a, b, inside = _unbounded(products, a_range, b_range)
    edge_a, edge_b = _on_edge(products, a_range, b_range, a, b)
    return jnp.where(inside, a, edge_a), jnp.where(inside, b, edge_b)


def bounded_pair_seldom_on_edge(
    products: Products, a_range: Range, b_range: Range
) -> tuple[Array, Array]:
    """The same for one problem; in a batch none looks at the edges unless one of them must."""
    a, b, inside = _unbounded(products, a_range, b_range)

    def on_edge() -> tuple[Array, Array]:
        edge_a, edge_b = _on_edge(products, a_range, b_range, a, b)
        return jnp.where(inside, a, edge_a), jnp.where(inside, b, edge_b)

    found: tuple[Array, Array] = jax.lax.cond(_of_any(~inside), on_edge, lambda: (a, b))
    return found


@jax.custom_batching.custom_vmap
def _of_any(condition: Whether) -> Whether:
    """The condition; in a batch, one for all: whether it holds for any of them."""
    return condition


@_of_any.def_vmap
def _of_batch(_: int, __: list[bool], condition: Bool[Array, "*batch"]) -> tuple[Array, bool]:
    return jnp.any(condition), False


def _unbounded(
    products: Products, a_range: Range, b_range: Range
) -> tuple[Array, Array, Bool[Array, "..."]]:
    """The a and b without bounds, and whether they are determined and within them."""
    y_phi, y_psi, phi_phi, psi_psi, phi_psi = products
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
    return a, b, inside


def _on_edge(
    products: Products, a_range: Range, b_range: Range, best_a: Array, best_b: Array
) -> tuple[Array, Array]:
    """The best a and b on an edge; those given where none has a value, because a sum is NaN."""
    y_phi, y_psi, phi_phi, psi_psi, phi_psi = products
    edges = [(jnp.clip((y_phi - b * phi_psi) / phi_phi, *a_range), b) for b in b_range]
    edges += [(a, jnp.clip((y_psi - a * phi_psi) / psi_psi, *b_range)) for a in a_range]
    best = jnp.full_like(best_a, jnp.inf)
    for edge_a, edge_b in edges:
        value = edge_a * (edge_a * phi_phi + 2 * edge_b * phi_psi - 2 * y_phi)
        value = value + edge_b * (edge_b * psi_psi - 2 * y_psi)
        better = value < best
        best = jnp.where(better, value, best)
        best_a = jnp.where(better, edge_a, best_a)
        best_b = jnp.where(better, edge_b, best_b)
    return best_a, best_b
