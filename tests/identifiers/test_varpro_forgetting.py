"""Burckhardt's curve by least squares that forget: against scipy, and by Monte Carlo."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import least_squares

from adhesion_jax.identifiers import IDENTIFIERS
from adhesion_jax.records import Record
from adhesion_jax.scenarios.rails import HE2018, RAILS

NAMES = ("varpro-forgetting", "varpro-forgetting-offset")
DRY = RAILS["dry"]


def law(x, slip):
    return np.sign(slip) * x[0] * (1 - np.exp(-x[1] * np.abs(slip))) - x[2] * slip


def runs(count, points, offset=0.0, sigma=0.01, seed=0):
    rng = np.random.default_rng(seed)
    slip = rng.uniform(0.0, 0.2, (count, points))
    noise = sigma * rng.normal(size=slip.shape)
    return slip, law([DRY.c1, DRY.c2, DRY.c3], slip) + offset + noise


def found(name, slip, adhesion, method=None):
    """The estimates after one record of all the samples of each run."""
    method = method or IDENTIFIERS[name]

    def of_run(slip, adhesion):
        every = jnp.ones(slip.shape, dtype=bool)
        state = method.init(HE2018, jax.random.key(0))
        return method.estimate(method.update(state, Record(slip, adhesion, every, every, {})))

    return jax.jit(jax.vmap(of_run))(jnp.asarray(slip), jnp.asarray(adhesion))


@pytest.mark.parametrize("name", NAMES)
def test_it_finds_the_weighted_least_squares_of_scipy(name):
    offset = name.endswith("offset")
    slip, adhesion = runs(4, 400, 0.03 * offset, 0.003, seed=2)
    estimate = found(name, slip, adhesion)
    weight = np.sqrt(0.997 ** np.arange(399, -1, -1))
    for i in range(len(slip)):

        def error(x, i=i):
            shift = x[3] if offset else 0.0
            return weight * (law(x, slip[i]) + shift - adhesion[i])

        expected = least_squares(error, [0.8, 40, 0.4, 0.0][: 3 + offset], x_scale="jac").x
        # One step from the nearest of 48 steepnesses leaves the square of half their distance.
        for at, parameter in enumerate(("c1", "c2", "c3")):
            assert estimate.values[parameter][i] == pytest.approx(expected[at], rel=2e-3)


@pytest.mark.parametrize("name", NAMES)
def test_its_interval_holds_the_truth_also_where_the_sensor_is_off(name):
    slip, adhesion = runs(256, 600, 0.05 * name.endswith("offset"), seed=5)
    estimate = found(name, slip, adhesion)
    place = [*estimate.values].index("mu_max")
    error = np.asarray(estimate.values["mu_max"]) - float(DRY.peak({}).adhesion)
    deviation = np.sqrt(np.asarray(estimate.covariance)[:, place, place])
    assert 0.91 < np.mean(np.abs(error) < 1.96 * deviation) < 0.985
    assert np.std(error) < 0.01


def test_it_follows_a_change_of_the_rail_at_the_rate_of_its_factor():
    slip, adhesion = runs(1, 2000, sigma=1e-4)
    adhesion[:, 1000:] *= 0.8
    fast = dataclasses.replace(IDENTIFIERS["varpro-forgetting"], factor=0.98)
    mu_max = 0.8 * float(DRY.peak({}).adhesion)
    assert found("", slip, adhesion, fast).values["mu_max"][0] == pytest.approx(mu_max, rel=1e-3)


def test_it_takes_streams_as_well_as_blocks():
    stream = dataclasses.replace(HE2018, by_sample=True)
    assert all(IDENTIFIERS[name].accepts(stream) is None for name in NAMES)
