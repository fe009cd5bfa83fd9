"""Streams composed of a rail that changes, an excitation and noise; the bound along them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import least_squares

from adhesion_jax.curves import free_values, with_free_values
from adhesion_jax.errors import InputError
from adhesion_jax.metrics.information import information_along
from adhesion_jax.scenarios import SCENARIOS, Options, build
from adhesion_jax.scenarios.catalogue import stream
from adhesion_jax.scenarios.rail_process import Change
from adhesion_jax.scenarios.rails import FORMS, RAILS, changed, initial_slope, peak_of

peak_under = jax.jit(lambda rail, conditions: rail.peak(conditions))


def drawn(scenario, key):
    """A record of a scenario, and its bound."""

    @jax.jit
    def both(key):
        record = scenario.draw(key)
        return record, scenario.bound(record)

    return both(key)


STREAMS = [name for name, one in SCENARIOS.items() if getattr(one, "func", one) is stream]


@pytest.mark.parametrize("truth", FORMS)
def test_a_rail_that_changes_has_its_peak_where_it_is_said(truth):
    form = FORMS[truth]
    for name, rail in form.rails.items():
        conditions = dict(form.conditions)
        before = peak_under(rail, conditions)
        after = peak_under(changed(truth, name, 0.8, 1.3), conditions)
        assert float(after.adhesion) == pytest.approx(0.8 * float(before.adhesion), rel=1e-6)
        assert float(after.slip) == pytest.approx(1.3 * float(before.slip), rel=1e-6)
        same = changed(truth, name, 1.0, 1.0)
        for own, other in zip(jax.tree.leaves(same), jax.tree.leaves(rail), strict=True):
            assert own == other
        rise = rail(jnp.asarray(1e-7), conditions) / 1e-7
        assert initial_slope(rail) == pytest.approx(float(rise), rel=1e-4)
    assert initial_slope(changed("kiencke", "dry", 0.5, 2.0)) == 40.0


def test_the_rails_by_exponentials_have_the_peaks_and_the_slopes_of_those_by_burckhardt():
    for name, rail in FORMS["exponential"].rails.items():
        found = rail.peak({})
        assert (float(found.slip), float(found.adhesion)) == pytest.approx(peak_of(RAILS[name]))
        assert initial_slope(rail) == pytest.approx(initial_slope(RAILS[name]), rel=1e-12)


def test_what_becomes_of_a_rail_is_as_by_hand():
    level, stretch = Change(fall=0.2, shift=0.5).course(101)
    np.testing.assert_allclose(level, np.linspace(1, 0.8, 101), rtol=1e-14)
    np.testing.assert_allclose(stretch, np.linspace(1, 1.5, 101), rtol=1e-14)
    level, stretch = Change(fall=0.4, recovery=50.0).course(200)
    assert np.all(level[:100] == 1)
    assert level[100] == pytest.approx(0.6)
    assert level[150] == pytest.approx(1 - 0.4 / np.e)
    level, _ = Change(wave=0.1, period=40.0).course(81)
    assert level[[0, 10, 20, 30, 40]] == pytest.approx([1, 1.1, 1, 0.9, 1])


def test_a_rail_keeps_some_adhesion():
    level, _ = Change(fall=0.4, wave=0.5).course(1001)  # at the second trough .65 - .5 is left
    assert 0.14 < level.min() < 0.16
    with pytest.raises(InputError, match=r"--fall 0\.9 and --wave 0\.5 leave -0\.29 of"):
        build("stream", Options(fall=0.9, wave=0.5))
    with pytest.raises(InputError, match=r"--recovery 50 is .* nothing is lost; give --fall too"):
        Change(recovery=50.0).course(200)
    with pytest.raises(InputError, match=r"--period 80 is that of the wave, .* give --wave too"):
        Change(fall=0.2, period=80.0).course(200)
    with pytest.raises(InputError, match="must stay above 0"):
        Change(fall=0.9, wave=0.5, recovery=900.0, period=1000.0).course(1000)


def test_a_stream_follows_its_rail_and_says_where_it_ends_and_what_it_is_told():
    options = Options(truth="exponential", rail="wet", then="dry", fall=0.3, sigma=0.0, points=200)
    scenario = build("stream", options)
    record = scenario.draw(jax.random.key(1))
    slip, adhesion = np.ravel(record.slip), np.ravel(record.adhesion)
    level = 1 - 0.3 * np.arange(200) / 199
    for k in (0, 99, 100, 199):
        rail = FORMS["exponential"].rails["wet" if k < 100 else "dry"]
        assert adhesion[k] == pytest.approx(
            level[k] * float(rail(jnp.asarray(slip[k]), {})), rel=1e-12
        )
    assert scenario.rails == ("wet",) * 10 + ("dry",) * 10
    peak = peak_of(RAILS["dry"])[1]
    assert scenario.quantities()["mu_max"][-1] == pytest.approx(0.7 * peak, rel=1e-9)
    assert float(scenario.known.curve.a0) == pytest.approx(15 * 0.165 - 0.1)
    recovering = build("recovery", Options(points=200))
    assert recovering.rails == ("dry",) * 10 + ("dry, recovering",) * 10


@pytest.mark.parametrize("name", ["single", "stream"])
def test_noise_of_the_slip_is_in_what_is_measured_alone(name):
    points = 200
    noisy = build(name, Options(slip_noise=0.002, sigma=0.0, points=points, truth="burckhardt"))
    keys = jax.random.split(jax.random.key(3), 300)
    record = jax.jit(jax.vmap(noisy.draw, out_axes=noisy.run_axes))(keys)
    # Without noise the adhesion tells the true slip, up to the peak.
    slip = np.linspace(0, 0.095, 2000)
    curve = np.asarray(RAILS["dry"](jnp.asarray(slip), {}))
    adhesion = np.asarray(record.adhesion).reshape(300, points)
    if name == "single":
        true = np.broadcast_to(np.linspace(0, 0.2, points), adhesion.shape)
        risen = true < 0.09
    else:
        true = np.interp(adhesion, curve, slip)
        risen = adhesion < curve[-200]
        near = np.abs(np.asarray(record.slip).reshape(300, points) - true) < 0.01
        risen &= near  # and not on the branch beyond the peak
    error = (np.asarray(record.slip).reshape(300, points) - true)[risen] / 0.002
    assert error.size > 10_000
    assert abs(np.mean(error)) < 4.5 / np.sqrt(error.size)
    assert np.std(error) == pytest.approx(1, abs=4.5 / np.sqrt(2 * error.size))


def test_the_bound_under_noise_of_the_slip_is_that_of_noise_of_adhesion_as_large():
    scenario = build("single", Options(slip_noise=0.002, sigma=0.01, points=300))
    record, bound = drawn(scenario, jax.random.key(0))
    slip = np.asarray(record.slip)[0]
    c1, c2, c3 = (float(x) for x in free_values(RAILS["dry"]))
    decay = np.exp(-c2 * slip)
    jacobian = np.stack([1 - decay, c1 * slip * decay, -slip], axis=1)
    variance = 0.01**2 + (0.002 * (c1 * c2 * decay - c3)) ** 2
    expected = np.linalg.inv((jacobian / variance[:, None]).T @ jacobian)
    found = np.asarray(bound)[0, :3]
    np.testing.assert_allclose(found, np.sqrt(np.diag(expected)), rtol=1e-6)


def prior_of(path):
    """Rows that the first step is a standard normal mean of, and the same for its changes."""
    steps = np.diff(path, axis=0)
    weights, spreads, rows = np.linalg.svd(steps, full_matrices=False)
    reach = np.diag(spreads) @ rows / np.sqrt(len(steps))
    changes = np.diff(weights * np.sqrt(len(steps)), axis=0)
    np.testing.assert_allclose(reach.T @ reach, steps.T @ steps / len(steps), atol=1e-12)
    return reach, np.linalg.cholesky(changes.T @ changes / len(changes)).T


def jointly(rows, path, sigma):
    """The covariance of the parameters after the last sample, from all unknowns at once.

    They are the first parameters, of which nothing is known, and standard normal ones for the
    first step and for each of its changes.
    """
    reach, changes = prior_of(path)
    samples, free = rows.shape
    parameters = np.zeros((samples, free, free * (1 + samples)))
    parameters[:, :, :free] = np.eye(free)
    weights = np.zeros((free, free * (1 + samples)))
    weights[:, free : 2 * free] = np.eye(free)
    for k in range(1, samples):
        parameters[k] = parameters[k - 1] + reach.T @ weights
        weights = weights.copy()
        if k < samples - 1:
            weights[:, free * (1 + k) : free * (2 + k)] += changes.T
    seen = np.einsum("kf,kfu->ku", rows, parameters)
    known = np.ones(seen.shape[1])
    known[:free] = 0.0
    covariance = np.linalg.inv(seen.T @ seen / sigma**2 + np.diag(known))
    return parameters[-1] @ covariance @ parameters[-1].T


def test_the_information_along_a_path_is_the_covariance_of_the_exact_filter():
    """In a linear model: against all unknowns at once, and 10,000 runs of Kalman filters."""
    rng = np.random.default_rng(0)
    samples, sigma, runs = 60, 0.3, 10_000
    sensitivity = rng.normal(size=(samples, 2))
    taken = rng.normal(size=(samples, 2)) @ np.array([[0.05, 0.08], [0.0, 0.02]])
    path = np.cumsum(np.cumsum(taken, axis=0), axis=0)
    found = information_along(jnp.asarray(sensitivity.T), jnp.asarray(path.T), sigma, 10)
    bound = sigma**2 * np.linalg.inv(np.asarray(found))

    reach, changes = prior_of(path)
    onwards = np.block([[np.eye(2), reach.T], [np.zeros((2, 2)), np.eye(2)]])
    q = np.zeros((4, 4))
    q[2:, 2:] = changes.T @ changes
    truth = np.concatenate([np.zeros((runs, 2)), rng.normal(size=(runs, 2))], axis=1)
    mean, covariance = np.zeros((runs, 4)), np.diag([1e8, 1e8, 1.0, 1.0])
    for k, own in enumerate(sensitivity):
        truth, mean = truth @ onwards.T, mean @ onwards.T
        truth[:, 2:] += rng.normal(size=(runs, 2)) @ changes
        covariance = onwards @ covariance @ onwards.T + q
        row = np.concatenate([own, [0, 0]])
        seen = truth @ row + sigma * rng.normal(size=runs)
        gain = covariance @ row / (row @ covariance @ row + sigma**2)
        mean = mean + (seen - mean @ row)[:, None] * gain
        covariance = covariance - np.outer(gain, row @ covariance)
        if (k + 1) % 10 == 0:
            np.testing.assert_allclose(bound[k // 10], covariance[:2, :2], rtol=1e-5)
    error = (mean - truth)[:, :2]
    np.testing.assert_allclose(
        np.var(error, axis=0) / np.diag(bound[-1]), 1, atol=4.5 * np.sqrt(2 / runs)
    )


def test_the_bound_of_a_drifting_rail_is_that_of_all_unknowns_along_its_own_path():
    scenario = build(
        "switch-drift", Options(points=200, shift=0.3, sigma=0.02, autocorrelation=0.5)
    )
    record, bound = drawn(scenario, jax.random.key(2))
    slip, curve = np.ravel(record.slip), scenario.rail.curve
    path = np.stack([curve.p1, curve.p2], axis=-1)
    for stretch, report in ((slice(0, 100), 9), (slice(100, 200), 19)):
        own, at = path[stretch], slip[stretch]
        moves = np.eye(2)[:, None] * 1e-4 * own  # [parameter, sample, parameter]
        up, down = (adhesion_of(own + sign * moves, at) for sign in (1, -1))
        rows = ((up - down) / (2 * moves.sum(axis=-1))).T
        white = np.vstack([rows[:1], (rows[1:] - 0.5 * rows[:-1]) / np.sqrt(0.75)])
        expected = np.sqrt(np.diag(jointly(white, own, 0.02)))
        np.testing.assert_allclose(np.asarray(bound)[report, :2], expected, rtol=1e-3)


def adhesion_of(values, slip):
    return 40 * slip / (1 + values[..., 0] * slip + values[..., 1] * slip**2)


@pytest.mark.long
def test_without_a_drift_the_bound_is_that_of_a_rail_that_stays():
    still, slow = (build("stream", Options(points=200, fall=fall)) for fall in (0.0, 1e-9))
    record, bound = drawn(still, jax.random.key(4))
    found = jax.jit(lambda record: slow.bound(record))(record)
    np.testing.assert_allclose(found, bound, rtol=1e-5)
    assert not still.rail.drifts
    assert slow.rail.drifts


@pytest.mark.thorough
@pytest.mark.parametrize("name", STREAMS)
def test_every_stream_has_samples_and_a_bound(name):
    scenario = build(name, Options(points=200))
    record = jax.jit(lambda key: scenario.draw(key))(jax.random.key(0))
    assert record.slip.shape == (20, 10)
    assert scenario.known.by_sample
    bound = np.asarray(jax.jit(lambda record: scenario.bound(record))(record))
    assert bound.shape == (20, len(scenario.quantities()))
    assert np.all(np.isfinite(bound[10:]))
    assert np.all(bound[10:] > 0)
    assert scenario.rail.drifts == any(word in name for word in ("drift", "wave", "recovery"))


@pytest.mark.parametrize("told", ["burckhardt", "kiencke"])
@pytest.mark.parametrize("truth", FORMS)
def test_the_curve_told_comes_near_the_truth_inside_its_box(truth, told):
    """So that a wrong form is judged and not the box; on dry rail, least squares by scipy."""
    scenario = build("single", Options(truth=truth, told=told))
    known, slip = scenario.known, scenario.excitation.slips()
    clean = np.asarray(scenario.rail.adhesion(slip, {}))
    start = np.asarray(free_values(known.curve))
    found = least_squares(
        lambda x: (
            np.asarray(with_free_values(known.curve, jnp.asarray(x))(jnp.asarray(slip), {})) - clean
        ),
        start,
        x_scale=start,
    )
    assert np.sqrt(np.mean(found.fun**2)) < 0.013
    assert np.all(found.x > known.lower)
    assert np.all(found.x < 0.95 * np.asarray(known.upper))
