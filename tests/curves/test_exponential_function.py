"""The exponential function against decimal numbers of 40 digits, and its derivatives."""

from decimal import Decimal, localcontext

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from adhesion_jax.curves.exponential_function import exp

#: Unit in the last place of numbers from 1 to 2.
UNIT = 2.0**-52


def relative_errors(x):
    found = jax.jit(exp)(jnp.asarray(x))
    with localcontext() as context:
        context.prec = 40
        exact = [Decimal(one).exp() for one in x.tolist()]
        errors = [Decimal(f) / e - 1 for f, e in zip(found.tolist(), exact, strict=True)]
    return np.array(errors, float)


@pytest.mark.parametrize(
    ("lowest", "highest"), [(-708.0, 709.78), (-50.0, 0.0), (-1.0, 1.0), (-1e-9, 1e-9)]
)
def test_the_error_is_below_one_unit_in_the_last_place(lowest, highest):
    x = np.random.default_rng(1).uniform(lowest, highest, 20_000)
    x = np.concatenate([x, np.linspace(lowest, highest, 5)])
    assert np.abs(relative_errors(x)).max() < UNIT


def test_the_error_is_as_small_where_the_power_of_two_changes():
    halves = (np.arange(-1021, 1024) + 0.5) * np.log(2.0)
    for x in (halves, np.nextafter(halves, np.inf), np.nextafter(halves, -np.inf)):
        within = x[(x >= -708.0) & (x <= 709.78)]
        assert np.abs(relative_errors(within)).max() < UNIT


def test_ends_of_the_range():
    x = jnp.array([0.0, -0.0, -708.06, -1e4, -1e300, -jnp.inf, 709.79, 1e4, 1e300, jnp.inf])
    np.testing.assert_array_equal(exp(x), [1.0, 1.0, 0, 0, 0, 0, *[np.inf] * 4])
    largest = np.log(np.finfo(float).max)
    assert np.isfinite(exp(jnp.asarray(largest - 1e-12)))
    assert np.isnan(exp(jnp.asarray(jnp.nan)))


def test_every_derivative_is_the_function_itself():
    x = jnp.linspace(-30.0, 3.0, 41)
    once = jax.vmap(jax.grad(exp))
    twice = jax.vmap(jax.grad(jax.grad(exp)))
    np.testing.assert_array_equal(once(x), exp(x))
    np.testing.assert_array_equal(twice(x), exp(x))
    ahead = jax.jvp(lambda x: exp(-(x**2)), (x,), (jnp.ones_like(x),))[1]
    np.testing.assert_allclose(ahead, -2 * x * np.exp(-(np.asarray(x) ** 2)), rtol=1e-12)
    # Far from the origin too, where a derivative by way of the polynomial would not be finite.
    far = jax.vmap(jax.grad(exp))(jnp.array([-1e5, -708.2, -jnp.inf]))
    np.testing.assert_array_equal(far, 0.0)


def test_it_has_the_same_values_in_a_program_and_over_runs():
    x = jnp.linspace(-20.0, 1.0, 60).reshape(12, 5)
    np.testing.assert_allclose(jax.jit(jax.vmap(exp))(x), exp(x), rtol=UNIT)
    one_by_one = [float(exp(one)) for one in x[0]]
    np.testing.assert_allclose(exp(x[0]), one_by_one, rtol=UNIT)


def test_other_precisions_keep_theirs():
    x = jnp.linspace(-80.0, 80.0, 17, dtype=jnp.float32)
    assert exp(x).dtype == jnp.float32
    np.testing.assert_array_equal(exp(x), jnp.exp(x))
