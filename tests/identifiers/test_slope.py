"""The slope by recursive least squares: the recursion, its theory, its scenario."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from adhesion_jax.campaign.job import Config
from adhesion_jax.campaign.monte_carlo import run_campaign
from adhesion_jax.errors import InputError
from adhesion_jax.identifiers import IDENTIFIERS, Status, identify
from adhesion_jax.identifiers.rls_slope import RecursiveSlope, rls_slope
from adhesion_jax.records import Record
from adhesion_jax.scenarios import SCENARIOS, Options, build, needs_options
from adhesion_jax.scenarios.rails import HE2018

STREAM = build("fang2018-slope")
RUNS = 100


@functools.cache
def streams(options=Options()):
    scenario = build("fang2018-slope", options)
    keys = jax.random.split(jax.random.key(0), RUNS)
    records = jax.vmap(scenario.draw, out_axes=scenario.run_axes)(keys)
    run = jax.jit(jax.vmap(identify, (None, None, scenario.run_axes, 0)))
    return scenario, records, run(rls_slope, scenario.known, records, keys)


def numpy_loop(mu, velocity, time, gamma, constant):
    """Eq. 11 of Fang et al. 2018 on filtered differences, as it is printed.

    In extended precision: the printed P loses digits while the start is diffuse.
    """
    mu, velocity = mu.astype(np.longdouble), velocity.astype(np.longdouble)
    low_mu, low_velocity, theta, p = mu[0], velocity[0], 0.0, 1e12
    course = []
    for k in range(1, mu.size):
        span = time[k] - time[k - 1]
        share = 1 - np.exp(-span / constant)
        new_mu = low_mu + share * (mu[k] - low_mu)
        new_velocity = low_velocity + share * (velocity[k] - low_velocity)
        y, phi = (new_mu - low_mu) / span, (new_velocity - low_velocity) / span
        low_mu, low_velocity = new_mu, new_velocity
        kappa = 1 / (1 + gamma * phi**2)
        theta = theta - p * phi / (1 + phi * p * phi) * (theta * phi - y)
        p = (p - p * phi * phi * p / (1 + phi * p * phi)) / kappa
        course.append((theta, kappa))
    return np.array(course, dtype=float)


def test_the_recursion_is_that_of_the_paper():
    _, records, estimate = streams()
    for run in range(2):
        mu = np.asarray(records.adhesion[run]).ravel()
        velocity = np.asarray(records.conditions["slip_velocity_mps"][run]).ravel()
        time = np.asarray(records.conditions["time_s"]).ravel()
        ends = numpy_loop(mu, velocity, time, 0.3, 0.1)[8::10]
        np.testing.assert_allclose(estimate.values["slope"][run], ends[:, 0], rtol=1e-7, atol=1e-9)
        np.testing.assert_allclose(estimate.forgetting[run], ends[:, 1], rtol=1e-10)


def test_scatter_is_what_is_claimed_and_the_slope_is_followed():
    scenario, _, estimate = streams()
    assert np.all(np.asarray(estimate.status) == Status.TRUSTED)
    slope, truth = np.asarray(estimate.values["slope"]), scenario.quantities()["slope"]
    claimed = np.sqrt(np.mean(np.asarray(estimate.covariance)[:, 10:, 0, 0]))
    scatter = np.sqrt(np.mean(np.var(slope[:, 10:], axis=0, ddof=1)))
    assert claimed == pytest.approx(scatter, rel=0.1)
    assert np.sqrt(np.mean((slope[:, 10:] - truth[10:]) ** 2)) < 0.1
    # Behind a slope that changes it lags: that is not scatter, and not claimed.
    bias = np.mean(slope[:, 10:], axis=0) - truth[10:]
    assert np.sqrt(np.mean(bias**2)) > claimed


def test_the_slope_of_a_straight_line_without_noise_is_exact():
    time = 0.01 * jnp.arange(400.0)
    velocity = 1 + 0.5 * jnp.sin(time)
    every = jnp.ones((400, 1), dtype=bool)
    columns = {"slip_velocity_mps": velocity[:, None], "time_s": time[:, None]}
    record = Record(velocity[:, None] / 20, 0.1 - 0.07 * velocity[:, None], every, every, columns)
    estimate = identify(rls_slope, HE2018, record, jax.random.key(0))
    np.testing.assert_allclose(estimate.values["slope"][2:], -0.07, rtol=1e-9)
    assert np.all(np.asarray(estimate.covariance[2:]) < 1e-9)


def test_variance_and_p_at_constant_phi_are_those_of_the_theory():
    """White noise in y: P tends to gamma, var(theta) to gamma s^2/(2 + gamma phi^2)."""
    gamma, phi, deviation, rng = 0.2, 1.3, 0.5, np.random.default_rng(0)
    span, runs, samples = 0.01, 4000, 150
    # The filter let through nearly unchanged (its time constant far below a sample), the
    # adhesion is the sum of independent increments, so that y is white.
    y = 0.4 * phi + deviation * rng.normal(size=(runs, samples))
    mu = np.cumsum(y * span, axis=1)
    time = span * np.arange(samples)
    velocity = np.broadcast_to(phi * time, mu.shape)
    method = RecursiveSlope(jnp.asarray(gamma), jnp.asarray(1e-4))

    @jax.jit
    @jax.vmap
    def last(mu, velocity):
        every = jnp.ones(samples, dtype=bool)
        columns = {"slip_velocity_mps": velocity, "time_s": jnp.asarray(time)}
        record = Record(velocity / 20, mu, every, every, columns)
        return method.update(method.init(HE2018, jax.random.key(0)), record).recursion

    state = last(jnp.asarray(mu), jnp.asarray(velocity))
    np.testing.assert_allclose(state.p, gamma, rtol=1e-9)
    np.testing.assert_allclose(state.kappa, 1 / (1 + gamma * phi**2), rtol=1e-12)
    expected = gamma * deviation**2 / (2 + gamma * phi**2)
    assert np.var(state.theta) == pytest.approx(expected, rel=4 * np.sqrt(2 / runs))
    assert np.mean(state.theta) == pytest.approx(0.4, abs=4 * np.sqrt(expected / runs))


def test_noise_of_the_slip_velocity_attenuates_the_slope():
    """Unfiltered differences, phi at random: E phi^2/(E phi^2 + 2 sigma_v^2/Ts^2)."""
    rng, span, sigma_v, samples, runs = np.random.default_rng(1), 0.01, 0.004, 400, 200
    phi = rng.normal(size=(runs, samples))
    velocity = np.cumsum(phi * span, axis=1)
    mu = 0.4 * velocity
    measured = velocity + sigma_v * rng.normal(size=velocity.shape)
    time = span * np.arange(samples)
    # Hardly any forgetting: the mean of all samples.
    method = RecursiveSlope(jnp.asarray(1e-6), jnp.asarray(1e-4))

    @jax.jit
    @jax.vmap
    def last(mu, velocity):
        every = jnp.ones(samples, dtype=bool)
        columns = {"slip_velocity_mps": velocity, "time_s": jnp.asarray(time)}
        record = Record(velocity / 20, mu, every, every, columns)
        return method.update(method.init(HE2018, jax.random.key(0)), record).recursion.theta

    theta = np.asarray(last(jnp.asarray(mu), jnp.asarray(measured)))
    attenuated = 0.4 / (1 + 2 * sigma_v**2 / span**2)
    spread = np.std(theta, ddof=1) / np.sqrt(runs)
    assert attenuated < 0.33
    # The ratio of two means over a run is off by a share of about 1/samples of itself.
    assert np.mean(theta) == pytest.approx(attenuated, abs=4 * spread + 3 * attenuated / samples)


def test_it_rests_while_the_slip_velocity_rests():
    time = 0.01 * jnp.arange(600.0)
    moving = jnp.minimum(time, 2.0)
    rng = np.random.default_rng(2)
    mu = 0.1 + 0.05 * moving + 1e-3 * rng.normal(size=600)
    every = jnp.ones((60, 10), dtype=bool)
    columns = {"slip_velocity_mps": moving.reshape(60, 10), "time_s": time.reshape(60, 10)}
    record = Record(moving.reshape(60, 10) / 20, mu.reshape(60, 10), every, every, columns)
    estimate = identify(rls_slope, HE2018, record, jax.random.key(0))
    np.testing.assert_allclose(estimate.forgetting[-10:], 1.0, rtol=1e-12)
    slope = np.asarray(estimate.values["slope"])
    assert np.ptp(slope[-10:]) < 1e-9
    assert slope[-1] == pytest.approx(0.05, abs=0.02)


def test_a_sample_that_is_not_finite_is_left_out_and_counted():
    """The estimates are those of the samples that are left, with their times."""
    _, records, _ = streams()
    velocity, time = (records.conditions[name] for name in ("slip_velocity_mps", "time_s"))
    conditions = {"slip_velocity_mps": velocity[0], "time_s": time}
    one = Record(records.slip[0], records.adhesion[0], records.mask, records.fresh, conditions)
    gap = one._replace(fresh=one.fresh.at[5, 3].set(False))
    spoiled = one._replace(adhesion=one.adhesion.at[5, 3].set(jnp.nan))
    expected, found = (
        identify(rls_slope, HE2018, record, jax.random.key(0)) for record in (gap, spoiled)
    )
    np.testing.assert_array_equal(found.values["slope"], expected.values["slope"])
    np.testing.assert_array_equal(found.status, expected.status)
    np.testing.assert_array_equal(found.skipped, np.arange(180) == 5)
    np.testing.assert_array_equal(expected.skipped, 0)


@pytest.mark.parametrize("rail", ["dry", "common", "wet"])
def test_the_stream_crosses_the_peak_and_its_truth_is_the_derivative(rail):
    scenario = build("fang2018-slope", Options(rail=rail))
    record = scenario.draw(jax.random.key(1))
    curve, time = scenario.rail.curve, np.asarray(record.conditions["time_s"])
    peak = float(curve.peak({}).slip)
    slip = np.asarray(scenario.excitation.slip(jnp.asarray(time)))
    assert slip.min() == pytest.approx(0.2 * peak, rel=1e-6)
    assert slip.max() == pytest.approx(1.6 * peak, rel=1e-4)
    assert np.diff(time.ravel()) == pytest.approx(0.01)
    ends, step = jnp.asarray(slip[:, -1]), 1e-6
    expected = (curve(ends + step, {}) - curve(ends - step, {})) / (2 * step) / 20.0
    np.testing.assert_allclose(scenario.quantities()["slope"], expected, atol=1e-8)
    np.testing.assert_allclose(
        record.slip, np.asarray(record.conditions["slip_velocity_mps"]) / 20.0, rtol=1e-14
    )
    velocity_noise = 20.0 * (np.asarray(record.slip) - slip)
    assert np.std(velocity_noise) == pytest.approx(0.005, rel=0.1)
    noise = np.asarray(record.adhesion) - np.asarray(curve(jnp.asarray(slip), {}))
    assert np.std(noise) == pytest.approx(0.01, rel=0.1)
    assert abs(np.corrcoef(noise.ravel(), velocity_noise.ravel())[0, 1]) < 4.5 / np.sqrt(1800)


def test_the_slope_is_asked_for_here_alone_and_by_nobody_else():
    for name in [name for name in SCENARIOS if not needs_options(name)]:
        accepted = rls_slope.accepts(build(name).known) is None
        assert accepted == (name == "fang2018-slope"), name
    takers = [name for name, method in IDENTIFIERS.items() if method.accepts(STREAM.known) is None]
    assert takers == ["rls-slope"]


@pytest.mark.parametrize(
    ("options", "option"),
    [
        (Options(blocks=3), "--blocks"),
        (Options(rail="icy"), "--rail icy"),
        (Options(points=95), "--points 95"),
        (Options(points=105), "--points 105"),
    ],
)
def test_options_that_do_not_fit_are_refused_by_name(options, option):
    with pytest.raises(InputError, match=option) as refused:
        build("fang2018-slope", options)
    assert str(refused.value).endswith(".")


@pytest.mark.thorough
def test_a_campaign_reports_the_slope():
    config = Config("fang2018-slope", (), Options(points=300), runs=40)
    campaign = run_campaign(config, [].append, [].append, workers=1)
    summary = campaign.tables["summary"]
    assert list(summary["quantity"]) == ["slope"]
    assert list(summary["identifier"]) == ["rls-slope"]
    row = summary.iloc[0]
    assert np.isfinite(row[["bias", "rmse", "coverage95"]].astype(float)).all()
    assert np.isnan(row["crlb"])
    assert row["at_bound_share"] == row["failure_share"] == 0
    assert list(campaign.tables["checkpoints"]["k"]) == [100, 200, 300]
    assert set(campaign.tables["bands"]["quantity"]) == {"slope", "forgetting"}


def test_the_stream_has_the_period_and_the_noise_that_it_is_said_to_have():
    """Slip velocity from its least to its largest and back in 8 s, measured with .005 m/s."""
    _, records, _ = streams()
    measured = np.asarray(records.conditions["slip_velocity_mps"]).reshape(RUNS, -1)
    time = np.asarray(records.conditions["time_s"]).ravel()
    # By least squares over all runs: a constant and one wave, whose period fits best.
    periods = np.linspace(7.6, 8.4, 81)
    left = []
    for period in periods:
        angle = 2 * np.pi * time / period
        design = np.stack([np.ones_like(time), np.cos(angle), np.sin(angle)], axis=1)
        left.append(np.linalg.lstsq(design, measured.mean(axis=0), rcond=None)[1][0])
    assert periods[np.argmin(left)] == pytest.approx(8.0, abs=0.011)
    noise = measured - measured.mean(axis=0)
    assert noise.std() * np.sqrt(RUNS / (RUNS - 1)) == pytest.approx(
        0.005, rel=4 / np.sqrt(2 * noise.size)
    )
