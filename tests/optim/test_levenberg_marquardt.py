import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize

from adhesion_jax.optim.levenberg_marquardt import bounded_step, fit, normal_equations, solved
from adhesion_jax.optim.turns import Turns, compacted_while_loop, in_groups

# Without optimisation: programs that run once.
quick_jit = functools.partial(jax.jit, compiler_options={"xla_backend_optimization_level": 0})

X = jnp.linspace(0.0, 0.2, 60)
LOWER, UPPER = jnp.array([0.1, 10.0, 0.05]), jnp.array([1.0, 50.0, 0.5])
CENTRE = 0.5 * (LOWER + UPPER)


def model(x):
    return x[0] * (1 - jnp.exp(-x[1] * X)) - x[2] * X


def noisy(runs, seed, sigma=0.02):
    """Curves of parameters inside the box and outside: many a best fit lies on it."""
    random = np.random.default_rng(seed)
    truth = random.uniform(0.7 * LOWER, 1.2 * UPPER, (runs, 3))
    clean = jax.vmap(model)(jnp.asarray(truth))
    return jnp.asarray(clean + sigma * random.normal(size=clean.shape))


def fit_one(y, start):
    return fit(lambda x: model(x) - y, start, LOWER, UPPER, 60)


def residual_of_scipy(x, y):
    return np.asarray(x[0] * (1 - np.exp(-x[1] * X)) - x[2] * X - y)


def best_of_scipy(y):
    """The least sum of squares in the box that scipy finds from several starts."""
    starts = [CENTRE, [0.3, 20.0, 0.2], [0.8, 45.0, 0.4], [0.2, 12.0, 0.1]]
    found = [
        scipy.optimize.least_squares(
            residual_of_scipy, np.asarray(start), bounds=(LOWER, UPPER), args=(np.asarray(y),),
            x_scale=[1, 50, 1], xtol=1e-14, ftol=1e-14, gtol=1e-14,
        )
        for start in starts
    ]  # fmt: skip
    return min(found, key=lambda one: one.cost)


@pytest.mark.long
def test_the_fit_is_that_of_scipy_inside_the_box_and_on_each_of_its_faces():
    ys = noisy(40, seed=3)
    found = quick_jit(jax.vmap(fit_one, in_axes=(0, None)))(ys, CENTRE)
    assert np.all(found.converged)
    faces = set()
    for x, objective, y in zip(np.asarray(found.x), found.objective, ys, strict=True):
        best = best_of_scipy(y)
        assert float(objective) <= 2 * best.cost * (1 + 1e-9)
        # scipy keeps away from the bounds by a little.
        np.testing.assert_allclose(x, best.x, rtol=2e-3, atol=1e-4)
        faces |= {(i, "lower") for i in range(3) if x[i] == LOWER[i]}
        faces |= {(i, "upper") for i in range(3) if x[i] == UPPER[i]}
    assert len(faces) >= 4  # exactly on the bound, and not on one alone


@pytest.mark.long
def test_a_batch_gives_each_run_what_it_finds_alone_and_takes_its_own_steps():
    # More runs than advance side by side, some near their optimum and some far.
    ys = noisy(77, seed=8)
    starts = jnp.where(jnp.arange(77)[:, None] % 3 == 0, CENTRE, jnp.array([0.99, 11.0, 0.06]))
    together = quick_jit(jax.vmap(fit_one))(ys, starts)
    one_alone = quick_jit(fit_one)
    alone = [one_alone(y, start) for y, start in zip(ys, starts, strict=True)]
    steps = np.array([int(one.steps) for one in alone])
    np.testing.assert_allclose(np.asarray(together.steps), steps, atol=1)
    assert steps.max() > 1.5 * np.median(steps)
    for place, one in enumerate(alone):
        np.testing.assert_allclose(together.x[place], one.x, rtol=1e-6)
        assert bool(together.converged[place]) == bool(one.converged)


@pytest.mark.long
def test_a_batch_of_batches_and_shared_data_are_batches_as_well():
    ys = noisy(6, seed=1).reshape(2, 3, -1)
    found = quick_jit(jax.vmap(jax.vmap(fit_one, in_axes=(0, None)), in_axes=(0, None)))(ys, CENTRE)
    starts = jnp.stack([CENTRE, jnp.array([0.3, 30.0, 0.1])])
    from_both = quick_jit(jax.vmap(fit_one, in_axes=(None, 0)))(ys[0, 0], starts)
    for place in np.ndindex(2, 3):
        alone = quick_jit(fit_one)(ys[place], CENTRE)
        np.testing.assert_allclose(found.x[place], alone.x, rtol=1e-6)
    np.testing.assert_allclose(from_both.x[1], from_both.x[0], rtol=1e-6)


def test_a_step_within_bounds_minimises_the_damped_quadratic_over_the_box():
    random = np.random.default_rng(5)
    step_of = quick_jit(bounded_step)
    cut = 0
    for _ in range(30):
        columns = random.normal(size=(4, 12))
        columns[1] = columns[0] + 0.3 * columns[1]
        local = normal_equations([*jnp.asarray(columns)], jnp.asarray(random.normal(size=12)))
        lower, upper = -random.uniform(0.01, 1, 4), random.uniform(0.01, 1, 4)
        damping = 0.1 * jnp.diag(local.hessian)
        step = np.asarray(step_of(jnp.zeros(4), local, damping, jnp.array(lower), jnp.array(upper)))
        matrix = np.asarray(local.hessian) + np.diag(damping)
        slope = matrix @ step + np.asarray(local.gradient)
        inside = (step > lower) & (step < upper)
        # Of those inside none is to move; the others stopped where they reached their bound.
        np.testing.assert_allclose(slope[inside], 0.0, atol=1e-9 * np.abs(matrix).max())
        assert np.all((step >= lower) & (step <= upper))
        cut += not np.all(inside)
    assert 10 < cut < 30


@pytest.mark.parametrize("size", [1, 2, 3, 7, 8, 9, 20])
def test_positive_definite_systems_are_solved(size):
    random = np.random.default_rng(size)
    root = random.normal(size=(size, 2 * size))
    matrix, right = root @ root.T, random.normal(size=size)
    x, pivots = quick_jit(solved)(jnp.asarray(matrix), jnp.asarray(right))
    np.testing.assert_allclose(x, np.linalg.solve(matrix, right), rtol=1e-9)
    assert np.prod(np.asarray(pivots)) == pytest.approx(np.linalg.det(matrix), rel=1e-9)


@pytest.mark.parametrize("size", [3, 12])
def test_normal_equations_are_the_gradient_and_the_products_of_the_jacobian(size):
    random = np.random.default_rng(0)
    columns, left = random.normal(size=(size, 30)), random.normal(size=30)
    local = normal_equations([*jnp.asarray(columns)], jnp.asarray(left))
    assert float(local.loss) == pytest.approx(0.5 * left @ left)
    np.testing.assert_allclose(local.gradient, columns @ left, rtol=1e-12)
    np.testing.assert_allclose(local.hessian, columns @ columns.T, rtol=1e-12, atol=1e-12)


def collatz_length(number):
    length = 0
    while number != 1:
        number = number // 2 if number % 2 == 0 else 3 * number + 1
        length += 1
    return length


@pytest.mark.parametrize(("count", "axis"), [(1, 0), (5, -1), (100, 0), (100, -1)])
def test_iterations_in_turns_end_each_at_its_own_step(count, axis):
    numbers = jnp.arange(1, count + 1)

    def advance(factor, add, state):
        number, length, _ = state
        ahead = jnp.where(number % 2 == 0, number // 2, factor * number + add)
        return ahead, length + 1, jnp.stack([length, length], axis=-1 - axis)

    def unfinished(state):
        return state[0] != 1

    pairs = jnp.zeros((count, 2) if axis == 0 else (2, count), numbers.dtype)
    start = (numbers, jnp.zeros_like(numbers), pairs)
    given = jnp.asarray(3), jnp.ones_like(numbers)

    @quick_jit
    def all_of_them(start, given):
        return compacted_while_loop(
            unfinished, advance, start, given, (None, axis), Turns(32, 2, axis)
        )

    number, length, last = all_of_them(start, given)
    expected = np.array([collatz_length(n) for n in range(1, count + 1)])
    np.testing.assert_array_equal(number, 1)
    np.testing.assert_array_equal(length, expected)
    np.testing.assert_array_equal(last[:, 1] if axis == 0 else last[1], np.maximum(expected - 1, 0))


@pytest.mark.parametrize("count", [1, 3, 4, 11])
def test_groups_give_what_a_whole_batch_gives(count):
    """Halvings until a number is at most `least`: how many differs from one to another."""

    def halved(pair, least):
        def step(state):
            return state[0] / 2, state[1] + 1

        return jax.lax.while_loop(lambda state: state[0] > least, step, (pair[0] + pair[1], 0))

    random = np.random.default_rng(count)
    first, second = jnp.asarray(random.uniform(1, 1000, count)), jnp.asarray(3.0)
    leasts = jnp.asarray(random.uniform(0.1, 10, count))
    grouped = in_groups(halved, 4)
    for axes, least in (((0, None), None), leasts[0]), (((0, None), 0), leasts):
        found, numbers = jax.vmap(grouped, axes)((first, second), least)
        sums = np.asarray(first) + 3.0
        wanted = np.maximum(np.ceil(np.log2(sums / np.asarray(least))), 0)
        np.testing.assert_array_equal(numbers, wanted)
        np.testing.assert_array_equal(found, sums / 2**wanted)
    alone, number = grouped((first[0], second), leasts[0])
    assert (alone, number) == (found[0], numbers[0])
