"""The filters against exact ones: the textbook's, a recursion in closed form, all paths."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from identifier_cases import FILTERS, identified
from lanes import lanes

from adhesion_jax.campaign.job import Config
from adhesion_jax.campaign.monte_carlo import run_campaign
from adhesion_jax.curves import with_free_values
from adhesion_jax.identifiers import IDENTIFIERS
from adhesion_jax.identifiers.filters import coordinates_of
from adhesion_jax.identifiers.imm_rails import InteractingModels, named_rails
from adhesion_jax.identifiers.kalman import ExtendedKalmanFilter, UnscentedKalmanFilter
from adhesion_jax.identifiers.particle import ParticleFilter
from adhesion_jax.optim.kalman import Gaussian, lower_root
from adhesion_jax.records import Record
from adhesion_jax.scenarios import Options, build
from adhesion_jax.scenarios.rails import HE2018, QIAN2024, RAILS

STREAM = build("qian2024-switch", Options(points=200))


def course_of(identifier, known, slip, adhesion):
    """The recursion after each sample, and before the first."""

    def one(state, point):
        fresh = jnp.ones(1, dtype=bool)
        state = identifier.update(state, Record(*(x[None] for x in point), fresh, fresh, {}))
        return state, state.recursion

    begun = identifier.init(known, jax.random.key(1))
    after = jax.jit(lambda: jax.lax.scan(one, begun, (slip, adhesion))[1])()
    return begun.recursion, after


#: Textbook filters: nothing is adapted but the scale of the noise, and no sample is clipped.
PLAIN = {"huber": 1e9, "adaptation": 0.0, "walk": 3e-3}
KALMAN = {"ekf": ExtendedKalmanFilter(**PLAIN), "ukf": UnscentedKalmanFilter(**PLAIN)}


def by_the_textbook(name, belief, curve, gradient, measured, variance):
    """One sample by equations 5.26 and 5.84 of Sarkka 2013, with the parameters of Julier's points.

    Bayesian Filtering and Smoothing, Cambridge; in NumPy, with a root of the covariance by
    Cholesky's factorisation.
    """
    mean, covariance = belief
    size = mean.size
    if name == "ekf":
        slope = np.asarray(gradient(mean))
        predicted, cross = float(curve(mean)), covariance @ slope
        spread = slope @ cross
    else:
        method = KALMAN[name]
        lam = method.alpha**2 * (size + method.kappa) - size
        root = np.linalg.cholesky((size + lam) * covariance)
        points = np.array([mean, *(mean + root.T), *(mean - root.T)])
        of_mean = np.full(2 * size + 1, 0.5 / (size + lam))
        of_mean[0] = lam / (size + lam)
        of_spread = of_mean.copy()
        of_spread[0] += 1 - method.alpha**2 + method.beta
        values = np.array([float(curve(point)) for point in points])
        predicted = of_mean @ values
        spread = of_spread @ (values - predicted) ** 2
        cross = (of_spread * (values - predicted)) @ (points - mean)
    gain = cross / (spread + variance)
    return mean + gain * (measured - predicted), covariance - np.outer(gain, cross)


@pytest.mark.parametrize("name", KALMAN)
def test_the_kalman_filters_are_those_of_the_textbook(name):
    """On a stream whose rail switches, told the noise that the method found."""
    record = jax.tree.map(lambda x: x.reshape(-1)[:100], STREAM.draw(jax.random.key(3)))
    method, known = KALMAN[name], STREAM.known
    begun, after = course_of(method, known, record.slip, record.adhesion)
    assert not np.any(after.reset)
    scales = np.concatenate([[begun.scale], after.scale[:-1]])
    step = method.walk**2 * np.eye(2)
    belief = np.asarray(begun.belief.mean), np.asarray(begun.belief.covariance)
    found = []

    def adhesion_at(x, slip):
        return with_free_values(known.curve, coordinates_of(known).to_box(x))(slip, {})

    value, slope = jax.jit(adhesion_at), jax.jit(jax.grad(adhesion_at))
    for slip, adhesion, scale in zip(*map(np.asarray, record[:2]), scales, strict=True):
        curve, gradient = (functools.partial(one, slip=slip) for one in (value, slope))
        walked = belief[0], belief[1] + step
        belief = by_the_textbook(name, walked, curve, gradient, float(adhesion), scale**2)
        found.append(belief)
    means, covariances = map(np.array, zip(*found, strict=True))
    np.testing.assert_allclose(after.belief.mean, means, rtol=1e-8)
    np.testing.assert_allclose(after.belief.covariance, covariances, rtol=1e-8, atol=1e-14)


@functools.partial(jax.jit, static_argnums=0)
def followed(method, belief, walk, row, measured, variance):
    """The belief after one sample of a linear model."""
    walked = method.walked(belief, walk)
    return method.learned(walked, functools.partial(jnp.dot, row), measured, variance)


def test_a_curve_that_is_linear_makes_the_unscented_filter_the_exact_one():
    """And the extended one: a recursion in closed form, by NumPy."""
    rng = np.random.default_rng(1)
    rows, measured = rng.normal(size=(30, 3)), rng.normal(size=30)
    mean, covariance = np.zeros(3), np.diag([1.0, 4.0, 0.25])
    beliefs = {name: Gaussian(jnp.zeros(3), jnp.asarray(covariance)) for name in KALMAN}
    for row, z in zip(rows, measured, strict=True):
        covariance = covariance + 0.01**2 * np.eye(3)
        gain = covariance @ row / (row @ covariance @ row + 0.3)
        mean = mean + gain * (z - row @ mean)
        covariance = covariance - np.outer(gain, row @ covariance)
        for name, belief in beliefs.items():
            beliefs[name] = followed(KALMAN[name], belief, 0.01, row, z, 0.3)
    for belief in beliefs.values():
        np.testing.assert_allclose(belief.mean, mean, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(belief.covariance, covariance, rtol=1e-9, atol=1e-12)


def test_the_root_of_a_covariance_is_cholesky_s_and_zero_where_there_is_none():
    matrix = np.cov(np.random.default_rng(2).normal(size=(4, 9)))
    np.testing.assert_allclose(lower_root(jnp.asarray(matrix)), np.linalg.cholesky(matrix))
    np.testing.assert_array_equal(lower_root(jnp.zeros((3, 3))), 0.0)


@pytest.mark.long
def test_particles_come_to_the_exact_kalman_filter_within_their_monte_carlo_error():
    """A linear model with a walk: means of many filters, and how they scatter about the mean."""
    filters, samples, noise, walk = 200, 60, 0.2, 0.05
    rng = np.random.default_rng(3)
    rows, path = rng.normal(size=(samples, 2)), np.cumsum(walk * rng.normal(size=(samples, 2)), 0)
    measured = np.sum(rows * path, axis=1) + np.sqrt(noise) * rng.normal(size=samples)
    method = ParticleFilter(particles=400)

    def one(belief, point):
        row, z = point
        belief = method.walked(belief, jnp.asarray(walk))
        model = functools.partial(jnp.dot, row)
        belief = method.learned(belief, model, z, jnp.asarray(noise))
        return belief, method.summary(belief)

    def run(key):
        begun = method.start(QIAN2024, jnp.zeros(2), key)
        return jax.lax.scan(one, begun, (jnp.asarray(rows), jnp.asarray(measured)))[1]

    found = jax.jit(jax.vmap(run))(jax.random.split(jax.random.key(4), filters))
    exact = []
    belief = Gaussian(jnp.zeros(2), jnp.eye(2))
    for row, z in zip(rows, measured, strict=True):
        belief = followed(KALMAN["ekf"], belief, walk, row, z, noise)
        exact.append(belief)
    means, covariances = (np.stack([one[i] for one in exact]) for i in (0, 1))
    deviation = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    error = (np.asarray(found.mean) - means) / deviation
    scatter = error.std(axis=0)
    assert np.all(scatter < 0.25)  # 400 particles of which no fewer than half count: 1/sqrt(200)
    assert np.all(np.abs(error.mean(axis=0)) < 4.5 * scatter / np.sqrt(filters) + 0.01)
    share = np.diagonal(found.covariance, axis1=2, axis2=3) / deviation**2
    np.testing.assert_allclose(share.mean(axis=0), 1.0, atol=0.05)


def paths(method, rails, start, rows, measured, noise, walk):
    """Weight, mean, covariance and last mode of all paths, each by a Kalman filter of its own."""
    modes, size = len(rails) + 1, rails.shape[1]
    near, wide = method.nearness**2 * np.eye(size), method.spread**2 * np.eye(size)
    weight, mode = np.full(modes, 1 / modes), np.arange(modes)
    mean = np.vstack([rails, start])
    covariance = np.stack([near] * (modes - 1) + [wide])
    for row, z in zip(rows, measured, strict=True):
        old = mode[:, None] == np.arange(modes)
        named = np.arange(modes)[:, None] < modes - 1
        share = np.where(old, 1 - method.switching, method.switching / (modes - 1))
        begun = np.where(named, np.vstack([rails, start]), mean[:, None])
        fresh = np.where(named[..., None], near, covariance[:, None] + wide)
        mean = np.where(old[..., None], mean[:, None], begun).reshape(-1, size)
        covariance = np.where(old[..., None, None], covariance[:, None], fresh)
        covariance = covariance.reshape(-1, size, size) + walk**2 * np.eye(size)
        variance, miss = row @ covariance @ row + noise, z - mean @ row
        gain = covariance @ row / variance[:, None]
        weight = (weight[:, None] * share).ravel() * np.exp(-(miss**2) / variance / 2)
        weight = weight / np.sqrt(variance)
        mean = mean + gain * miss[:, None]
        covariance = covariance - gain[:, :, None] * (covariance @ row)[:, None]
        weight, mode = weight / weight.sum(), np.tile(np.arange(modes), len(mode))
    return weight, mean, covariance, mode


def test_the_modes_come_near_all_paths_over_eight_samples():
    """On a linear model, with beliefs merged and without: apart by a small part of a deviation."""
    method = InteractingModels(switching=0.05, nearness=0.3, clip=1e9)
    rails, start = np.array([[0.0, 0.0], [3.0, 1.0], [-2.0, 2.0]]), np.array([1.0, -1.0])
    noise, walk, rng = 0.3, 0.1, np.random.default_rng(5)
    rows = rng.normal(size=(8, 2))
    truth = np.where(np.arange(8)[:, None] < 4, rails[0], rails[1])
    measured = np.sum(rows * truth, axis=1) + np.sqrt(noise) * rng.normal(size=8)
    modes = method._around(jnp.asarray(rails), jnp.asarray(start))
    for row, z in zip(rows, measured, strict=True):
        modes = followed(method, modes, walk, row, z, noise)
    weight, means, covariances, last = paths(method, rails, start, rows, measured, noise, walk)
    assert weight.size == 4**9  # the first mode is one of four, too
    exact = np.array([weight[last == mode].sum() for mode in range(4)])
    mean = weight @ means
    covariance = np.einsum("p,pij->ij", weight, covariances)
    covariance += np.einsum("p,pi,pj->ij", weight, means - mean, means - mean)
    found = method.summary(modes)
    deviation = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(modes.weight, exact, atol=0.01)
    np.testing.assert_allclose((found.mean - mean) / deviation, 0.0, atol=0.01)
    np.testing.assert_allclose(found.covariance, covariance, rtol=0.05)


def test_the_named_rails_are_their_own_parameters_on_their_own_curve():
    own = jax.jit(named_rails)(HE2018)
    found = jax.vmap(coordinates_of(HE2018).to_box)(own)
    expected = [[rail.c1, rail.c2, rail.c3] for rail in RAILS.values()]
    np.testing.assert_allclose(found, expected, rtol=1e-6)


@pytest.mark.parametrize("name", lanes(FILTERS, always=1, long=3))
def test_hardly_any_noise_leaves_hardly_any_error(name):
    """The walk of the parameters leaves a ten-thousandth of mu_max; the slip is random."""
    scenario = build("qian2024-switch", Options(sigma=1e-9, points=200))
    _, estimate = identified(IDENTIFIERS[name], scenario)
    truth, before = scenario.quantities()["mu_max"], 9  # the last block before the switch
    np.testing.assert_allclose(estimate.values["mu_max"][:, before], truth[before], rtol=1e-3)


@functools.cache
def campaign(scenario):
    config = Config(scenario, tuple(FILTERS), runs=64)
    return run_campaign(config, lambda _: None, lambda _: None).tables


@pytest.mark.thorough
def test_the_filters_follow_a_switch_and_named_rails_are_found_sooner():
    tables = campaign("qian2024-switch")
    tracking = tables["tracking"].set_index(["rail", "identifier"])
    assert not tracking["missed_share"].drop("imm-rails", level="identifier").gt(0).any()
    delay = tracking["delay_median"].loc["common"]
    assert delay["imm-rails"] <= 6 < delay.drop("imm-rails").min()
    assert delay.max() <= 20
    summary = tables["summary"].set_index(["rail", "quantity", "identifier"])
    for name in FILTERS:
        for rail in ("dry", "common"):
            row = summary.loc[rail, "mu_max", name]
            assert row["coverage95"] > 0.9
