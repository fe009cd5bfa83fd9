"""The quadratic program of a batch, in which only some problems end on an edge."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from adhesion_jax.optim.quadratic_program import (
    Products,
    bounded_pair,
    bounded_pair_seldom_on_edge,
)


@pytest.mark.parametrize("width", [0.1, 100.0])
def test_programs_on_an_edge_are_solved_beside_others_that_are_not(width):
    random = np.random.default_rng(0)
    phi, psi, y = random.normal(size=(3, 50, 6))
    products = Products(
        *((y * phi).sum(1), (y * psi).sum(1)),
        *((phi**2).sum(1), (psi**2).sum(1)),
        (phi * psi).sum(1),
    )
    products = Products(*map(jnp.asarray, products))
    edges = jnp.asarray(-width), jnp.asarray(width)
    box = edges, edges
    expected = bounded_pair(products, *box)
    solve = jax.jit(jax.vmap(lambda given: bounded_pair_seldom_on_edge(given, *box)))
    np.testing.assert_allclose(solve(products), expected, rtol=1e-13)
    alone = bounded_pair_seldom_on_edge(Products(*(x[7] for x in products)), *box)
    np.testing.assert_allclose(alone, [x[7] for x in expected], rtol=1e-13)
