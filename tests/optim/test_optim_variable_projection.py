from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from lanes import lanes
from numpy.polynomial import Chebyshev
from scipy.optimize import lsq_linear, minimize_scalar

from adhesion_jax.optim import variable_projection
from adhesion_jax.optim.variable_projection import Sums, minimise, sum_of_squares, summarise

LOWER = np.array([0.1, 10.0, 0.05])
UPPER = np.array([1.0, 50.0, 0.5])
SLIP = np.linspace(0.0, 0.2, 120)


def model(parameters, slip):
    a, nu, b = parameters
    return a * (1 - np.exp(-nu * slip)) - b * slip


def sums_of(slip, y, mask=None, lower=LOWER, upper=UPPER):
    mask = np.ones(slip.shape, dtype=bool) if mask is None else mask
    slip, y, mask = jnp.asarray(slip), jnp.asarray(y), jnp.asarray(mask)
    ends = jnp.asarray(lower)[1], jnp.asarray(upper)[1]
    return summarise(lambda nu: 1 - jnp.exp(-nu * slip), -slip, y, mask, *ends)


_minimise = jax.jit(lambda sums, lower, upper: minimise(sums, lower, upper))


def exact(slip, y, mask=None, lower=LOWER, upper=UPPER):
    """The solution as (a, nu, b) and its objective."""
    found = _minimise(sums_of(slip, y, mask, lower, upper), jnp.asarray(lower), jnp.asarray(upper))
    return np.array([found.a, found.nu, found.b]), float(found.objective)


def brute_force(slip, y, lower=LOWER, upper=UPPER):
    """4001 values of nu, each with scipy's bounded linear least squares, then a bounded polish."""
    bounds = (lower[[0, 2]], upper[[0, 2]])

    def best_pair(nu):
        matrix = np.stack([1 - np.exp(-nu * slip), -slip], axis=-1)
        found = lsq_linear(matrix, y, bounds, method="bvls", tol=1e-14)
        return found.x, 2 * found.cost

    grid = np.linspace(lower[1], upper[1], 4001)
    values = np.array([best_pair(nu)[1] for nu in grid])
    best = int(np.argmin(values))
    ends = (grid[max(best - 1, 0)], grid[min(best + 1, 4000)])
    options = {"xatol": 1e-12 * upper[1]}
    polished = minimize_scalar(
        lambda nu: best_pair(nu)[1], bounds=ends, method="bounded", options=options
    )
    nu = polished.x if polished.fun < values[best] else grid[best]
    (a, b), objective = best_pair(nu)
    return np.array([a, nu, b]), objective


#: The truth and the coordinates that the box then holds: -1 low, +1 high. Truth beyond the box
#: and little noise put the optimum on its face.
CASES = {
    "interior-dry": ((0.8287, 45.45, 0.4), (0, 0, 0)),
    "interior-middle": ((0.5, 25.0, 0.3), (0, 0, 0)),
    "interior-slow": ((0.4, 12.0, 0.2), (0, 0, 0)),
    "a-low": ((0.05, 30.0, 0.1), (-1, None, None)),
    "a-high": ((1.3, 30.0, 0.3), (1, None, None)),
    "nu-low": ((0.5, 6.0, 0.1), (None, -1, None)),
    "nu-high": ((0.5, 80.0, 0.1), (None, 1, None)),
    "b-low": ((0.5, 30.0, -0.4), (None, None, -1)),
    "b-high": ((0.5, 30.0, 1.2), (None, None, 1)),
    "a-and-b-high": ((1.3, 30.0, 0.7), (1, None, None)),
    "nu-and-b-low": ((0.3, 5.0, -0.5), (None, -1, -1)),
    "a-low-b-high": ((0.01, 45.0, 2.0), (-1, None, 1)),
    "negative-data": ((-0.5, 30.0, 0.1), (-1, -1, 1)),
}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("sigma", lanes([0.05, 0.0], always=0, thorough=1))
def test_the_optimum_is_that_of_a_dense_grid_with_a_bounded_solver(case, sigma):
    truth, held = CASES[case]
    noise = np.random.default_rng(sum(map(ord, case))).normal(size=SLIP.size)
    y = model(truth, SLIP) + sigma * noise
    found, objective = exact(SLIP, y)
    expected, least = brute_force(SLIP, y)
    scale = y @ y
    assert np.all(found >= LOWER)
    assert np.all(found <= UPPER)
    assert objective == pytest.approx(
        float(np.sum((y - model(found, SLIP)) ** 2)), abs=1e-12 * scale
    )
    assert objective == pytest.approx(least, abs=1e-12 * scale)
    # Not above what the search finds, and near it: the valley is flat, its floor is not.
    direct = float(np.sum((y - model(found, SLIP)) ** 2))
    assert direct <= least * (1 + 1e-10) + 1e-16 * scale
    np.testing.assert_allclose(found, expected, rtol=2e-5, atol=1e-7)
    if sigma < 0.01:
        for value, side, low, high in zip(found, held, LOWER, UPPER, strict=True):
            if side is not None:
                assert side != 0 or 1.001 * low < value < 0.999 * high
                assert value == pytest.approx({-1: low, 0: value, 1: high}[side], rel=1e-14)
    if sigma == 0.0 and held == (0, 0, 0):
        np.testing.assert_allclose(found, truth, rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_the_optimum_of_pure_noise_and_of_few_points_is_global_too(seed):
    # Nothing here follows the model: profiles with several valleys.
    rng = np.random.default_rng(seed)
    slip = np.sort(rng.uniform(0, 0.2, 6)) if seed % 2 else SLIP
    y = rng.normal(0.15, 0.1, slip.size)
    _, objective = exact(slip, y)
    _, least = brute_force(slip, y)
    assert objective <= least * (1 + 1e-9)
    assert objective == pytest.approx(least, rel=1e-9)


def test_another_box_and_another_range_of_x():
    lower, upper = np.array([0.01, 1.0, 0.0]), np.array([3.0, 40.0, 2.0])
    slip = np.linspace(0.0, 1.0, 200)
    noise = np.random.default_rng(3).normal(size=slip.size)
    y = model((1.4, 7.0, 0.9), slip) + 0.02 * noise
    found, objective = exact(slip, y, lower=lower, upper=upper)
    expected, least = brute_force(slip, y, lower, upper)
    np.testing.assert_allclose(found, expected, rtol=1e-6)
    assert objective == pytest.approx(least, rel=1e-11)


def test_masked_points_take_no_part():
    rng = np.random.default_rng(5)
    y = model((0.8287, 45.45, 0.4), SLIP) + 0.01 * rng.normal(size=SLIP.size)
    mask = rng.uniform(size=SLIP.size) < 0.5
    spoiled = np.where(mask, y, np.nan)
    found, objective = exact(SLIP, spoiled, mask)
    expected, least = exact(SLIP[mask], y[mask])
    np.testing.assert_allclose(found, expected, rtol=1e-9)
    assert objective == pytest.approx(least, rel=1e-10)
    everything, _ = exact(SLIP, y)
    assert np.max(np.abs(everything / found - 1)) > 1e-3


def test_sums_of_two_sets_of_data_add_up():
    rng = np.random.default_rng(6)
    y = model((0.32, 25.0, 0.1), SLIP) + 0.01 * rng.normal(size=SLIP.size)
    parts = sums_of(SLIP[:50], y[:50]), sums_of(SLIP[50:], y[50:])
    together, added = sums_of(SLIP, y), jax.tree.map(jnp.add, *parts)
    assert isinstance(added, Sums)
    for one, other in zip(together, added, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-11, atol=1e-11 * float(together.yy))
    lower, upper = jnp.asarray(LOWER), jnp.asarray(UPPER)
    one, other = _minimise(together, lower, upper), _minimise(added, lower, upper)
    # With which step the slope has come down to rounding is a matter of the last digits, and so of
    # the processor.
    one = one._replace(evaluations=other.evaluations)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-8), one, other)


@pytest.mark.parametrize("largest", [0.01, 0.2, 0.5, 1.0])
def test_the_objective_from_the_sums_is_the_direct_sum(largest):
    rng = np.random.default_rng(7)
    lower, upper = np.array([0.1, 1.0, 0.0]), np.array([1.0, 50.0, 0.5])
    slip = rng.uniform(-largest, largest, 80)
    sign = np.sign(slip)
    y = sign * model((0.8287, 45.45, 0.4), np.abs(slip)) + 0.01 * rng.normal(size=slip.size)
    ends = jnp.asarray(lower)[1], jnp.asarray(upper)[1]
    mask = jnp.ones(slip.shape, dtype=bool)

    def phi(nu):
        return jnp.asarray(sign) * (1 - jnp.exp(-nu * jnp.abs(jnp.asarray(slip))))

    sums = summarise(phi, -jnp.asarray(slip), jnp.asarray(y), mask, *ends)
    drawn = rng.uniform(lower, upper, (300, 3))
    drawn[0], drawn[1] = lower, upper
    a, nu, b = jnp.asarray(drawn.T)
    found = np.asarray(sum_of_squares(sums, a, nu, b, *ends))
    direct = [np.sum((y - sign * model(p, np.abs(slip))) ** 2) for p in drawn]
    np.testing.assert_allclose(found, direct, rtol=1e-9, atol=1e-11 * float(y @ y))


def test_a_batch_gives_what_each_run_gives_alone():
    rng = np.random.default_rng(8)
    truths = rng.uniform(0.6 * LOWER, 1.5 * UPPER, (40, 3))
    data = np.stack([model(t, SLIP) for t in truths]) + 0.01 * rng.normal(size=(40, SLIP.size))
    lower, upper = jnp.asarray(LOWER), jnp.asarray(UPPER)

    def solution(y):
        return minimise(sums_of(SLIP, y), lower, upper)

    batch = jax.jit(jax.vmap(solution))(jnp.asarray(data))
    for i in range(0, 40, 4):
        parameters, objective = exact(SLIP, data[i])
        np.testing.assert_allclose(
            [batch.a[i], batch.nu[i], batch.b[i]], parameters, rtol=1e-7, err_msg=str(i)
        )
        assert float(batch.objective[i]) == pytest.approx(objective, rel=1e-9)
    # A box for each run, the data shared.
    shrunk = jnp.asarray(np.linspace(0.5, 1.0, 5)[:, None] * UPPER)
    one_set = sums_of(SLIP, data[0])
    shrunk = shrunk.at[:, 1].set(UPPER[1])  # the range that the sums were taken for
    found = jax.jit(jax.vmap(lambda up: minimise(one_set, lower, up)))(shrunk)
    for i in range(5):
        alone = _minimise(one_set, lower, shrunk[i])
        jax.tree.map(lambda a, b, i=i: np.testing.assert_allclose(a[i], b, rtol=1e-7), found, alone)


@pytest.mark.parametrize("case", ["interior-dry", "a-high", "nu-low", "b-low", "a-and-b-high"])
def test_no_random_perturbation_inside_the_box_improves_the_optimum(case):
    rng = np.random.default_rng(9)
    y = model(CASES[case][0], SLIP) + 0.01 * rng.normal(size=SLIP.size)
    found, _ = exact(SLIP, y)
    least = np.sum((y - model(found, SLIP)) ** 2)
    sizes = 10.0 ** rng.uniform(-7, 0, (4000, 1))
    moved = np.clip(found + sizes * rng.normal(size=(4000, 3)) * (UPPER - LOWER), LOWER, UPPER)
    values = np.array([np.sum((y - model(p, SLIP)) ** 2) for p in moved])
    assert np.min(values) >= least * (1 - 1e-12)


@pytest.mark.parametrize("case", ["interior-dry", "interior-slow", "nu-high", "a-and-b-high"])
def test_the_sums_at_the_optimum_and_their_derivatives_are_those_of_the_points(case):
    y = model(CASES[case][0], SLIP) + 0.01 * np.random.default_rng(10).normal(size=SLIP.size)
    found = _minimise(sums_of(SLIP, y), jnp.asarray(LOWER), jnp.asarray(UPPER))
    decay, size = np.exp(-float(found.nu) * SLIP), SLIP
    of_phi_phi = (
        np.sum((1 - decay) ** 2),
        np.sum(2 * (1 - decay) * size * decay),
        np.sum(size**2 * (4 * decay**2 - 2 * decay)),
    )
    of_phi_psi = (
        -np.sum((1 - decay) * size),
        -np.sum(size**2 * decay),
        np.sum(size**3 * decay),
    )
    # Each derivative of a series loses digits, most of them where nu is at an end of its range.
    for jet, expected in ((found.phi_phi, of_phi_phi), (found.phi_psi, of_phi_psi)):
        np.testing.assert_allclose(jet, expected, rtol=1e-9, atol=1e-9 * abs(expected[0]))


def test_local_polynomials_are_those_of_exact_fractions():
    """Interpolation of T_d(middle + half t) at Chebyshev points, solved without rounding."""
    size = variable_projection._LOCAL_DEGREE + 1
    nodes = [Fraction(float(x)) for x in np.cos(np.pi * (np.arange(size) + 0.5) / size)]
    for cell in (0, 13, 31, 63):
        middle, half = (
            Fraction(float(x[cell]))
            for x in (variable_projection._MIDDLE, variable_projection._HALF)
        )
        rows = []
        for node in nodes:
            x = middle + half * node
            series = [Fraction(1), x]
            for _ in range(2, variable_projection.DEGREE):
                series.append(2 * x * series[-1] - series[-2])
            rows.append([node**k for k in range(size)] + series)
        for k in range(size):
            rows[k] = [x / rows[k][k] for x in rows[k]]
            for j in set(range(size)) - {k}:
                rows[j] = [x - rows[j][k] * y for x, y in zip(rows[j], rows[k], strict=True)]
        expected = np.array([[float(x) for x in row[size:]] for row in rows]).T
        np.testing.assert_allclose(variable_projection._TO_POWERS[cell], expected, atol=5e-15)


@pytest.mark.parametrize("box", [(20.0, 500.0), (10.0, 500.0), (5.0, 500.0), (1.0, 2000.0)])
def test_the_error_of_the_series_is_that_of_an_interpolation_by_numpy(box):
    x, share = np.linspace(0.01, 2, 50), box[1] / 3
    ends = [nu / (nu + share) for nu in box]

    def of_share(s):
        return np.exp(-share * s / (1 - s) * x[:, None])

    s = np.linspace(*ends, 2001)
    series = [
        Chebyshev.interpolate(lambda s, row=row: of_share(s)[row], 27, ends) for row in range(50)
    ]
    error = np.abs(np.stack([one(s) for one in series]) - of_share(s)).max()
    found = variable_projection.series_error(lambda nu: np.exp(-nu[:, None] * x), *box)
    assert 0.9 * error < found <= 1.01 * error
