"""Pooled maximum likelihood against brute force on the raw points, and its test for a change."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats
from scipy.optimize import least_squares

from adhesion_jax.curves.burckhardt import Burckhardt
from adhesion_jax.identifiers import IDENTIFIERS, Status, identify
from adhesion_jax.identifiers.ml_exact import (
    burckhardt_information,
    burckhardt_sums,
    chance,
    penalty,
)
from adhesion_jax.optim.variable_projection import minimise
from adhesion_jax.records import SHARED_SLIP, Known, Record
from adhesion_jax.scenarios import Options, build
from adhesion_jax.scenarios.rails import HE2018, RAILS

RUNS = 16
POOLED = IDENTIFIERS["ml-pooled"]
LOW, HIGH = np.asarray(HE2018.lower), np.asarray(HE2018.upper)

quick_jit = functools.partial(jax.jit, compiler_options={"xla_backend_optimization_level": 0})
identify_batch = quick_jit(jax.vmap(identify, (None, None, SHARED_SLIP, 0)))


@functools.cache
def pooled(scenario_name, options):
    scenario = build(scenario_name, options)
    keys = jax.random.split(jax.random.key(3), RUNS)
    records = jax.vmap(scenario.draw, out_axes=SHARED_SLIP)(keys)
    estimate = identify_batch(POOLED, scenario.known, records, keys)
    return scenario, jax.tree.map(np.asarray, records), jax.tree.map(np.asarray, estimate)


def law(theta, slip):
    return theta[0] * (1 - np.exp(-theta[1] * slip)) - theta[2] * slip


def brute_force(slip, adhesion):
    """The best of several searches of the raw points inside the box."""
    starts = [(0.3, c2, 0.2) for c2 in (12.0, 25.0, 45.0)]
    found = [
        least_squares(
            lambda theta: law(theta, slip) - adhesion,
            start,
            bounds=(LOW, HIGH),
            x_scale=(0.1, 10, 0.1),
            xtol=1e-14,
            ftol=1e-14,
            gtol=1e-14,
        )
        for start in starts
    ]
    return min(found, key=lambda result: result.cost)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("he2018-blocks", Options(points=120, blocks=9)),
        ("he2018-1", Options(points=100, rail="common")),
    ],
)
def test_the_estimate_is_that_of_all_raw_points_since_the_last_reset(name, options):
    _, records, estimate = pooled(name, options)
    fresh, slip = records.fresh, records.slip
    x, y, run = np.zeros(0), np.zeros(0), 0
    for block in range(slip.shape[0]):
        if estimate.reset[run, block]:
            x, y = np.zeros(0), np.zeros(0)
        taken = fresh[block]
        x = np.append(x, slip[block][taken])
        y = np.append(y, records.adhesion[run, block][taken])
        if block % 4 != 3 and block != slip.shape[0] - 1:
            continue
        theta = np.array([estimate.values[n][run, block] for n in ("c1", "c2", "c3")])
        least = np.sum((law(theta, x) - y) ** 2)
        best = brute_force(x, y)
        # Where the points hardly tell two curves apart only their misfits can be compared.
        assert least <= 2 * best.cost * (1 + 1e-7)
        if block == slip.shape[0] - 1:
            np.testing.assert_allclose(theta, best.x, rtol=1e-4)
            jacobian = np.stack(
                [1 - np.exp(-theta[1] * x), theta[0] * x * np.exp(-theta[1] * x), -x], axis=1
            )
            covariance = least / (x.size - 3) * np.linalg.inv(jacobian.T @ jacobian)
            np.testing.assert_allclose(
                estimate.covariance[run, block][:3, :3], covariance, rtol=1e-3
            )
        misfit = (law(theta, slip[block]) - records.adhesion[run, block])[records.mask[block]]
        assert estimate.objective[run, block] == pytest.approx(np.sum(misfit**2), rel=1e-9)


@pytest.mark.thorough
def test_a_switch_resets_the_pool_and_nothing_else_does():
    scenario, _, estimate = pooled("he2018-blocks", Options(points=120, blocks=9))
    expected = np.zeros((RUNS, 9), dtype=bool)
    expected[:, [3, 6]] = True
    np.testing.assert_array_equal(estimate.reset, expected)
    truth = scenario.quantities()["mu_max"]
    for rail in range(3):
        last = 3 * rail + 2
        error = estimate.values["mu_max"][:, last] - truth[last]
        assert np.sqrt(np.mean(error**2)) < 0.02 * truth[last]


POINTS = 200

#: The box of the paper would hold some of the estimates of the common rail.
WIDE = Known(HE2018.curve, jnp.array([0.01, 5.0, -2.0]), jnp.array([2.0, 80.0, 2.0]))


@quick_jit
@functools.partial(jax.vmap, in_axes=(0, None))
def two_halves(key, curve):
    """The penalty of one curve for two sets of data from the same rail, and its probability."""
    slip, every = jnp.linspace(0.0, 0.2, POINTS), jnp.ones(POINTS, dtype=bool)
    noisy = curve(slip, {}) + 0.01 * jax.random.normal(key, (2, POINTS))
    one, other = (burckhardt_sums(WIDE, Record(slip, y, every, every, {})) for y in noisy)
    both = jax.tree.map(jnp.add, one, other)
    stacked = jax.tree.map(lambda *x: jnp.stack(x), one, other, both)
    found = jax.lax.map(lambda sums: minimise(sums, WIDE.lower, WIDE.upper), stacked).objective
    count = jnp.asarray(2.0 * POINTS)
    cost = penalty(found[2], found[0] + found[1], both.yy, count)
    return cost, chance(cost, count)


@pytest.mark.slow
@pytest.mark.parametrize("rail", ["dry", "common"])
def test_the_penalty_on_an_unchanged_rail_is_chi_square_with_three_degrees_of_freedom(rail):
    cost, probability = two_halves(jax.random.split(jax.random.key(1), 1000), RAILS[rail])
    assert stats.kstest(np.asarray(cost), stats.chi2(3).cdf).pvalue > 1e-3
    np.testing.assert_allclose(probability, stats.f.sf(cost / 3, 3, 2 * POINTS - 6), rtol=1e-8)


def test_the_level_is_the_usual_critical_value_where_points_are_many():
    assert stats.chi2.sf(21.1, 3) == pytest.approx(1e-4, rel=0.02)
    assert float(chance(jnp.asarray(21.1), jnp.asarray(1e5))) == pytest.approx(1e-4, rel=0.03)


@quick_jit
def optimum(record):
    """c1, c2 and the information there."""
    sums = burckhardt_sums(HE2018, record)
    found = minimise(sums, jnp.asarray(HE2018.lower), jnp.asarray(HE2018.upper))
    return found.a, found.nu, burckhardt_information(sums, found)


@pytest.mark.parametrize("top", [0.1, 0.2, 0.5])
@pytest.mark.parametrize("side", ["traction", "both"])
def test_the_information_from_the_sums_is_that_of_the_points(top, side):
    slip = np.linspace(0.0 if side == "traction" else -0.7 * top, top, 90)
    every = jnp.ones(90, dtype=bool)
    adhesion = Burckhardt(0.32, 25.0, 0.1)(jnp.asarray(slip), {})
    c1, c2, found = optimum(Record(jnp.asarray(slip), adhesion, every, every, {}))
    assert c2 == pytest.approx(25.0, rel=1e-4)
    size = np.abs(slip)
    jacobian = np.stack(
        [
            np.sign(slip) * (1 - np.exp(-c2 * size)),
            np.sign(slip) * c1 * size * np.exp(-c2 * size),
            -slip,
        ],
        axis=1,
    )
    np.testing.assert_allclose(found, jacobian.T @ jacobian, rtol=1e-8)


@pytest.mark.long
def test_a_block_that_is_not_finite_is_left_out_of_the_pool():
    scenario = build("he2018-blocks", Options(points=120, blocks=9))
    keys = jax.random.split(jax.random.key(3), RUNS)
    records = jax.vmap(scenario.draw, out_axes=SHARED_SLIP)(keys)
    spoiled = records._replace(adhesion=records.adhesion.at[:, 1, 5].set(jnp.nan))
    estimate = identify_batch(POOLED, scenario.known, spoiled, keys)
    assert np.all(np.asarray(estimate.status)[:, 1] == Status.NOT_FINITE)
    assert np.all(np.asarray(estimate.status)[:, 2] == Status.TRUSTED)
    assert np.all(np.isfinite(estimate.values["mu_max"]))
    np.testing.assert_array_equal(estimate.values["mu_max"][:, 1], estimate.values["mu_max"][:, 0])
    assert not np.any(np.asarray(estimate.reset)[:, :3])
    np.testing.assert_array_equal(estimate.skipped, [[0, 120] + 7 * [0]] * RUNS)


@pytest.mark.parametrize("sigma", [0.0, 1e-9])
def test_data_with_hardly_any_noise_reset_it_at_the_switches_alone(sigma):
    scenario, _, estimate = pooled("he2018-blocks", Options(points=120, blocks=9, sigma=sigma))
    expected = np.zeros((RUNS, 9), dtype=bool)
    expected[:, [3, 6]] = True
    np.testing.assert_array_equal(estimate.reset, expected)
    truth = scenario.quantities()
    for name in ("c1", "c2", "c3", "mu_max"):
        np.testing.assert_allclose(
            estimate.values[name], np.tile(truth[name], (RUNS, 1)), rtol=1e-5
        )
