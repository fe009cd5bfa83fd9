"""Curves linear given one number, by least squares that forget: scipy and Monte Carlo."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import least_squares

from adhesion_jax.curves.burckhardt import Burckhardt
from adhesion_jax.curves.exponential import Exponential
from adhesion_jax.curves.kiencke import Kiencke
from adhesion_jax.curves.similar import Similar
from adhesion_jax.identifiers import IDENTIFIERS
from adhesion_jax.records import Known, Record
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


def found(name, slip, adhesion, method=None, known=HE2018):
    """The estimates after one record of all the samples of each run."""
    method = method or IDENTIFIERS[name]

    def of_run(slip, adhesion):
        every = jnp.ones(slip.shape, dtype=bool)
        state = method.init(known, jax.random.key(0))
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
            # The offset is held by a hundredth of a sample of mu(0) = 0.
            return np.append(weight * (law(x, slip[i]) + shift - adhesion[i]), 0.1 * shift)

        expected = least_squares(error, [0.8, 40, 0.4, 0.0][: 3 + offset], x_scale="jac").x
        # One step from the nearest of 48 steepnesses leaves the square of half their distance.
        for at, parameter in enumerate(("c1", "c2", "c3")):
            assert estimate.values[parameter][i] == pytest.approx(expected[at], rel=2e-3)


def test_slips_that_lie_close_to_each_other_tell_a_peak_all_the_same():
    """Where the offset is free altogether, the adhesion of the peak comes out to 19 % too large."""
    peak = float(DRY.peak({}).slip)
    rng = np.random.default_rng(7)
    slip = peak * (1 + 0.3 * np.sin(np.arange(2000) / 40)) * np.ones((8, 1))
    adhesion = law([DRY.c1, DRY.c2, DRY.c3], slip) + 1e-3 * rng.normal(size=slip.shape)
    estimate = found("varpro-forgetting-offset", slip, adhesion)
    np.testing.assert_allclose(estimate.values["slip_opt"], peak, rtol=0.1)
    largest = float(DRY.peak({}).adhesion)
    np.testing.assert_allclose(estimate.values["mu_max"], largest, rtol=0.02)


@pytest.mark.long
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


#: Of slip velocities in m/s: the curve of a dry rail in Uyulan et al. 2018, of which b/a is known.
RATIO = 2.2222
SHAPE = Exponential(a=1.0, b=RATIO, c=1.0)
VELOCITY = Known(Similar(SHAPE, 0.5, 0.2), [0.05, 0.02], [5.0, 3.0], slip_limit=3.0)


def exponential(x, velocity):
    left = np.exp(-np.abs(velocity) / x[1]) - np.exp(-RATIO * np.abs(velocity) / x[1])
    return np.sign(velocity) * x[0] * left


@pytest.mark.long
@pytest.mark.parametrize("name", NAMES)
def test_a_curve_of_known_shape_is_found_as_by_scipy_and_its_interval_holds_the_truth(name):
    offset, truth = 0.03 * name.endswith("offset"), np.array([1.258, 1 / 3.2666])
    rng = np.random.default_rng(8)
    slip = rng.uniform(-0.2, 2.0, (256, 400)) if not offset else rng.uniform(0.0, 2.0, (256, 400))
    adhesion = exponential(truth, slip) + offset + 0.01 * rng.normal(size=slip.shape)
    estimate = found(name, slip, adhesion, known=VELOCITY)
    weight = np.sqrt(0.997 ** np.arange(399, -1, -1))
    for i in range(4):

        def error(x, i=i):
            return weight * (exponential(x, slip[i]) + (x[2] if offset else 0.0) - adhesion[i])

        expected = least_squares(error, [1.0, 0.2, 0.0][: 3 if offset else 2], x_scale="jac").x
        assert estimate.values["level"][i] == pytest.approx(expected[0], rel=2e-3)
        assert estimate.values["stretch"][i] == pytest.approx(expected[1], rel=2e-3)
    # In closed form: ln(b/a)/(b - a), and the height there.
    top = exponential(truth, truth[1] * np.log(RATIO) / (RATIO - 1))
    for quantity, true in (("mu_max", top), ("slip_opt", truth[1] * np.log(RATIO) / (RATIO - 1))):
        place = [*estimate.values].index(quantity)
        deviation = np.sqrt(np.asarray(estimate.covariance)[:, place, place])
        held = np.abs(np.asarray(estimate.values[quantity]) - true) < 1.96 * deviation
        assert 0.91 < held.mean() < 0.985
    assert np.all(np.asarray(estimate.status) == 0)


def test_any_shape_may_be_known_and_a_parameter_that_is_known_makes_it_decline():
    truth = Similar(Kiencke(a0=40.0, p1=31.29, p2=100.0), 0.8, 1.5)
    known = Known(dataclasses.replace(truth, level=1.0, stretch=1.0), [0.1, 0.2], [4.0, 5.0])
    slip = np.random.default_rng(3).uniform(0.0, 0.3, (1, 200))
    adhesion = np.asarray(truth(jnp.asarray(slip), {}))
    estimate = found("varpro-forgetting", slip, adhesion, known=known)
    assert estimate.values["mu_max"][0] == pytest.approx(0.8 * 40 / (31.29 + 20), rel=1e-3)
    assert estimate.values["slip_opt"][0] == pytest.approx(0.15, rel=1e-3)
    half = dataclasses.replace(known, curve=dataclasses.replace(truth, free=("level",)))
    for name in NAMES:
        assert IDENTIFIERS[name].accepts(known) is None
        assert "level and its stretch" in IDENTIFIERS[name].accepts(half)


@pytest.mark.parametrize("name", NAMES)
def test_burckhardts_curve_may_be_one_of_slip_velocities(name):
    curve = Burckhardt(c1=0.3, c2=20.0, c3=0.1)
    known = Known(curve, [0.01, 2.0, 0.0], [2.0, 120.0, 2.0], slip_limit=10.0)
    truth = np.array([0.25, 9.0, 0.05])
    slip = np.random.default_rng(4).uniform(0.0, 1.5, (1, 400))
    estimate = found(name, slip, law(truth, slip), known=known)
    top = np.log(truth[0] * truth[1] / truth[2]) / truth[1]
    assert estimate.values["slip_opt"][0] == pytest.approx(top, rel=2e-3)
    assert estimate.values["mu_max"][0] == pytest.approx(law(truth, top), rel=1e-3)
