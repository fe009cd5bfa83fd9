"""A kernel computes what the function does, whatever of its arguments is known beforehand."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from adhesion_jax.optim.kernel import computed_once, in_one_kernel, scan_in_one_kernel
from adhesion_jax.optim.quadratic_program import (
    Products,
    bounded_pair,
    bounded_pair_seldom_on_edge,
)

VALUES = np.linspace(0.5, 1.5, 4)


def step(total, given):
    taken, value = given
    product = computed_once(lambda a, b: a * b)(total, value)
    return jnp.where(taken, total + product, total), None


def whole(start, taken, values):
    return scan_in_one_kernel(step, start, (taken, values))[0]


def by_hand(start, taken, values):
    return start * np.prod(np.where(taken, 1 + values, 1.0))


@pytest.mark.parametrize("count", [0, 1, 3])
@pytest.mark.parametrize("taken", [False, True])
def test_constants_among_the_arguments_change_nothing(count, taken):
    taken, values = np.full(count, taken), VALUES[:count]
    expected = by_hand(2.0, taken, values)
    known_mask = jax.jit(lambda start, values: whole(start, taken, values))
    known_start = jax.jit(lambda values: whole(jnp.asarray(2.0), jnp.asarray(taken), values))
    np.testing.assert_allclose(known_mask(2.0, jnp.asarray(values)), expected, rtol=1e-15)
    np.testing.assert_allclose(known_start(jnp.asarray(values)), expected, rtol=1e-15)
    batch = jax.jit(jax.vmap(whole, (0, None, 0)))(
        jnp.arange(5.0), jnp.asarray(taken), jnp.asarray(np.tile(values, (5, 1)))
    )
    np.testing.assert_allclose(batch, np.arange(5.0) / 2 * expected, rtol=1e-15)


def test_a_kernel_is_one_call_and_is_differentiated():
    taken, values = jnp.ones(4, dtype=bool), jnp.asarray(VALUES)
    text = jax.jit(whole).lower(2.0, taken, values).compile().as_text()
    assert "xla_cpu_small_call" in text
    expected = by_hand(2.0, np.ones(4, bool), VALUES) / (1 + VALUES)
    for derivative in (jax.grad, jax.jacfwd):
        found = jax.jit(derivative(whole, 2))(2.0, taken, values)
        np.testing.assert_allclose(found, expected, rtol=1e-14)


def test_a_kernel_is_nothing_special_on_another_processor():
    taken, values = jnp.ones(4, dtype=bool), jnp.asarray(VALUES)
    traced = jax.jit(whole).trace(2.0, taken, values)
    for word in ("xla_cpu_small_call", "inlineable"):
        assert word in traced.lower(lowering_platforms=("cpu",)).as_text()
        for others in (("cuda",), ("cpu", "cuda")):
            assert word not in traced.lower(lowering_platforms=others).as_text()


def test_a_kernel_passes_on_what_it_does_not_change():
    function = in_one_kernel(lambda a, b: (a, a + b))
    a, b = jax.jit(function)(jnp.ones(3), jnp.arange(3.0))
    np.testing.assert_array_equal(a, np.ones(3))
    np.testing.assert_array_equal(b, [1.0, 2.0, 3.0])


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
    expected = bounded_pair(*products, *box)
    solve = jax.jit(jax.vmap(lambda given: bounded_pair_seldom_on_edge(given, *box)))
    np.testing.assert_allclose(solve(products), expected, rtol=1e-13)
    alone = bounded_pair_seldom_on_edge(Products(*(x[7] for x in products)), *box)
    np.testing.assert_allclose(alone, [x[7] for x in expected], rtol=1e-13)
