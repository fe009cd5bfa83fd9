"""Noise that is not white, and a truth that is of another form than the curve assumed."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from adhesion_jax.curves import free_values, with_free_values
from adhesion_jax.errors import InputError
from adhesion_jax.identifiers import IDENTIFIERS, Status, identify
from adhesion_jax.records import SHARED_SLIP
from adhesion_jax.scenarios import Options, build
from adhesion_jax.scenarios.noise import Noise
from adhesion_jax.scenarios.rails import HE2018, KIENCKE_RAILS, RAILS

MISMATCHES = ("mismatch", "mismatch-kiencke")

quick_jit = functools.partial(jax.jit, compiler_options={"xla_backend_optimization_level": 0})
identify_batch = quick_jit(jax.vmap(identify, (None, None, SHARED_SLIP, 0)))


def identified(name, scenario, runs):
    keys = jax.random.split(jax.random.key(4), runs)
    records = jax.vmap(scenario.draw, out_axes=SHARED_SLIP)(keys)
    return identify_batch(IDENTIFIERS[name], scenario.known, records, keys)


@pytest.mark.thorough
def test_coloured_noise_has_the_deviation_and_the_correlation_of_the_recursion():
    noise = np.asarray(Noise(0.02, autocorrelation=0.8).draw(jax.random.key(0), (4000, 60))) / 0.02
    # Stationary from the first point on; 4.5 standard errors of 60 deviations.
    np.testing.assert_allclose(noise.std(axis=0), 1.0, atol=4.5 / np.sqrt(2 * 4000))
    assert np.all(np.abs(noise.mean(axis=0)) < 4.5 / np.sqrt(4000))
    assert stats.kstest(noise[:, 0], "norm").pvalue > 1e-3
    assert stats.kstest(noise[:, -1], "norm").pvalue > 1e-3
    for lag in (1, 2, 5, 20):
        products = np.mean(noise[:, lag:] * noise[:, :-lag], axis=1)
        error = np.std(products) / np.sqrt(4000)
        assert np.mean(products) == pytest.approx(0.8**lag, abs=4.5 * error)


def test_coloured_is_the_plain_recursion_and_whitened_takes_it_back():
    white = np.random.default_rng(0).normal(size=(3, 50))
    expected = white.copy()
    for k in range(1, 50):
        expected[:, k] = 0.7 * expected[:, k - 1] + np.sqrt(1 - 0.49) * white[:, k]
    noise = Noise(autocorrelation=0.7)
    made = jax.jit(lambda white: noise.coloured(white))(white)
    np.testing.assert_allclose(made, expected, atol=1e-13)
    whitened = jax.jit(lambda made: noise.whitened(made))(made)
    np.testing.assert_allclose(whitened, white, atol=1e-13)
    np.testing.assert_array_equal(Noise().coloured(jnp.asarray(white)), white)
    np.testing.assert_array_equal(Noise().whitened(jnp.asarray(white)), white)


@pytest.mark.thorough
def test_outliers_are_ten_times_the_coloured_noise():
    key, shape = jax.random.key(1), (20, 500)
    clean = np.asarray(Noise(0.01, 0.0, 0.8).draw(key, shape))
    spoiled = np.asarray(Noise(0.01, 0.1, 0.8).draw(key, shape))
    out = spoiled != clean
    np.testing.assert_allclose(spoiled[out], 10 * clean[out], rtol=1e-12)
    assert abs(out.mean() - 0.1) < 4.5 * np.sqrt(0.09 / out.size)


@pytest.mark.thorough
@pytest.mark.parametrize("rail", RAILS)
def test_the_bound_is_that_of_the_dense_inverse_covariance(rail):
    scenario = build("coloured", Options(rail=rail, points=200, sigma=0.02))
    c1, c2, c3 = (float(x) for x in free_values(RAILS[rail]))
    slip = np.linspace(0, 0.2, 200)
    decay = np.exp(-c2 * slip)
    jacobian = np.stack([1 - decay, c1 * slip * decay, -slip], axis=1)
    sigma = 0.02**2 * 0.8 ** np.abs(np.subtract.outer(np.arange(200), np.arange(200)))
    covariance = np.linalg.inv(jacobian.T @ np.linalg.solve(sigma, jacobian))
    peak = np.log(c1 * c2 / c3) / c2
    of_peak = np.array([1 - np.exp(-c2 * peak), c1 * peak * np.exp(-c2 * peak), -peak])
    of_slip = np.array([1 / (c1 * c2), (1 / c2 - peak) / c2, -1 / (c2 * c3)])
    gradient = np.vstack([np.eye(3), of_peak, of_slip])
    expected = np.sqrt(np.diag(gradient @ covariance @ gradient.T))
    bound = scenario.bound(scenario.draw(jax.random.key(0)))
    np.testing.assert_allclose(bound, expected[None], rtol=1e-6)


def test_the_noise_of_a_stream_is_coloured_across_its_reports():
    scenario = build("qian2024-switch", Options(autocorrelation=0.8, sigma=0.02, points=1000))
    quiet = build("qian2024-switch", Options(sigma=0.0, points=1000))
    keys = jax.random.split(jax.random.key(6), 300)
    drawn = [jax.jit(jax.vmap(one.draw))(keys).adhesion for one in (scenario, quiet)]
    noise = np.asarray(drawn[0] - drawn[1]).reshape(300, -1) / 0.02
    for lag in (1, 10, 15):
        products = np.mean(noise[:, lag:] * noise[:, :-lag], axis=1)
        error = np.std(products) / np.sqrt(300)
        assert np.mean(products) == pytest.approx(0.8**lag, abs=4.5 * error)
    within, across = noise[:, 8::10] * noise[:, 9::10], noise[:, 9:-1:10] * noise[:, 10::10]
    assert np.mean(across) == pytest.approx(np.mean(within), abs=0.02)


@pytest.mark.parametrize("name", ["qian2024-switch", "qian2024", "he2018-1"])
def test_the_bound_of_coloured_samples_is_that_of_the_dense_inverse_covariance(name):
    """Of a growing sequence that of all samples so far, of a stream those since the switch."""
    scenario = build(name, Options(points=100, sigma=0.02, autocorrelation=0.8))

    @jax.jit
    def drawn(key):
        record = scenario.draw(key)
        return record, scenario.bound(record)

    record, bound = jax.tree.map(np.asarray, drawn(jax.random.key(0)))
    truth = scenario.quantities()
    slips = np.ravel(record.slip) if name == "qian2024-switch" else np.asarray(record.slip[-1])
    ends = 10 * np.arange(1, 11) if name == "qian2024-switch" else scenario.support()
    for block in {0, len(ends) // 2 - 1, len(ends) - 1}:
        end, support = ends[block], scenario.support()[block]
        slip = slips[end - support : end]
        curve = KIENCKE_RAILS[scenario.rails[block]] if name != "he2018-1" else RAILS["dry"]
        theta = np.array([float(value) for value in free_values(curve)])
        jacobian = np.stack(
            [
                (adhesion_by_hand(name, up, slip) - adhesion_by_hand(name, down, slip)) / (2 * step)
                for up, down, step in moved(theta)
            ],
            axis=1,
        )
        places = np.arange(support)
        sigma = 0.02**2 * 0.8 ** np.abs(np.subtract.outer(places, places))
        expected = np.linalg.inv(jacobian.T @ np.linalg.solve(sigma, jacobian))
        found = bound[block, : theta.size]
        np.testing.assert_allclose(found, np.sqrt(np.diag(expected)), rtol=1e-4)
        assert truth["mu_max"][block] == pytest.approx(float(curve.peak({}).adhesion), rel=1e-9)


def adhesion_by_hand(name, theta, slip):
    if name == "he2018-1":
        return theta[0] * (1 - np.exp(-theta[1] * slip)) - theta[2] * slip
    return 40 * slip / (1 + theta[0] * slip + theta[1] * slip**2)


def moved(theta):
    """The parameters, one at a time, a step up and a step down, and the step."""
    for place, value in enumerate(theta):
        step = 1e-4 * value * np.eye(theta.size)[place]
        yield theta + step, theta - step, 1e-4 * value


@pytest.mark.slow
def test_least_squares_hardly_loses_by_colour_but_claims_a_third_of_its_error():
    """Both shares as computed for least squares on noise of this covariance in NumPy."""
    scenario = build("coloured")
    estimate = identified("ml-exact", scenario, 400)
    inside = np.asarray(estimate.status)[:, 0] == Status.TRUSTED
    assert inside.mean() > 0.95
    truth = float(scenario.quantities()["mu_max"][0])
    error = np.asarray(estimate.values["mu_max"])[:, 0] - truth
    claimed = np.sqrt(np.asarray(estimate.covariance)[:, 0, 3, 3])
    bound = float(scenario.bound(scenario.draw(jax.random.key(0)))[0, 3])
    rmse = np.sqrt(np.mean(error**2))
    assert rmse / bound == pytest.approx(1.001, abs=4 / np.sqrt(2 * 400))
    assert rmse / np.mean(claimed) == pytest.approx(2.99, rel=0.15)
    covered = np.mean(np.abs(error) < 1.965 * claimed)
    assert covered == pytest.approx(0.487, abs=4 * np.sqrt(0.25 / 400))


@pytest.mark.thorough
def test_coloured_is_single_but_for_the_noise():
    one, other = (build(name, Options(sigma=0.0)) for name in ("single", "coloured"))
    np.testing.assert_array_equal(
        one.draw(jax.random.key(0)).adhesion, other.draw(jax.random.key(0)).adhesion
    )
    assert other.known is HE2018
    assert one.tables() == other.tables()
    for name, value in one.quantities().items():
        np.testing.assert_array_equal(other.quantities()[name], value)


def polach(theta, slip, k_a, speed=20.0):
    """Polach 2005 in NumPy."""
    mu0, a, b, stiffness, k_s = theta
    friction = mu0 * ((1 - a) * np.exp(-b * slip * speed) + a)
    gradient = np.pi * stiffness * slip / (4 * friction)
    adhering = k_a * gradient / (1 + (k_a * gradient) ** 2)
    return 2 * friction / np.pi * (adhering + np.arctan(k_s * gradient))


TRUTHS = {
    "dry": ((0.55, 0.4, 0.6, 150.0, 0.4), 1.0),
    "wet": ((0.3, 0.4, 0.2, 150.0, 0.1), 0.3),
}


def grid_peak(theta, k_a):
    """The peak by a parabola through the three best points of a fine grid."""
    slip = np.linspace(0, 0.2, 20001)
    mu = polach(theta, slip, k_a)
    k = int(np.argmax(mu))
    bend, slope, level = np.polyfit(slip[k - 1 : k + 2] - slip[k], mu[k - 1 : k + 2], 2)
    top = -slope / (2 * bend)
    return np.array([level + slope * top / 2, slip[k] + top])


@pytest.mark.parametrize("name", MISMATCHES)
@pytest.mark.parametrize("rail", TRUTHS)
def test_the_truth_is_polachs_curve_and_its_peak_lies_within_the_block(name, rail):
    scenario = build(name, Options(rail=rail, sigma=0.0))
    record = scenario.draw(jax.random.key(0))
    theta, k_a = TRUTHS[rail]
    slip = np.linspace(0, 0.2, 500)
    np.testing.assert_allclose(record.slip[0], slip, atol=1e-15)
    np.testing.assert_allclose(record.adhesion[0], polach(theta, slip, k_a), atol=1e-14)
    found = [float(scenario.quantities()[q][0]) for q in ("mu_max", "slip_opt")]
    np.testing.assert_allclose(found, grid_peak(theta, k_a), rtol=1e-5)
    assert tuple(scenario.quantities()) == ("mu_max", "slip_opt")
    assert 0.02 < found[1] < 0.1


@pytest.mark.thorough
@pytest.mark.parametrize("rail", TRUTHS)
def test_the_bound_is_that_of_the_true_curve(rail):
    scenario = build("mismatch", Options(rail=rail, sigma=0.02))
    theta, k_a = TRUTHS[rail]
    theta, slip = np.array(theta), np.linspace(0, 0.2, 500)

    def derivative(function):
        columns = []
        for place, value in enumerate(theta):
            step = np.zeros(5)
            step[place] = 1e-4 * value
            columns.append((function(theta + step) - function(theta - step)) / (2e-4 * value))
        return np.stack(columns, axis=-1)

    jacobian = derivative(lambda t: polach(t, slip, k_a))
    scale = np.sqrt(np.sum(jacobian**2, axis=0))
    information = (jacobian / scale).T @ (jacobian / scale)
    gradient = derivative(lambda t: grid_peak(t, k_a)) / scale
    expected = 0.02 * np.sqrt(np.diag(gradient @ np.linalg.inv(information) @ gradient.T))
    bound = np.asarray(scenario.bound(scenario.draw(jax.random.key(0))))
    assert bound.shape == (1, 2)
    np.testing.assert_allclose(bound[0], expected, rtol=1e-2)


def test_the_initial_slope_that_kiencke_is_told_is_the_true_one():
    for rail, slope in (("dry", 105.0), ("wet", 30.0)):
        scenario = build("mismatch-kiencke", Options(rail=rail))
        theta, k_a = TRUTHS[rail]
        assert float(scenario.known.curve.a0) == pytest.approx(slope)
        assert polach(theta, 1e-9, k_a) / 1e-9 == pytest.approx(slope, rel=1e-6)


@pytest.mark.thorough
@pytest.mark.parametrize("name", MISMATCHES)
@pytest.mark.parametrize("rail", TRUTHS)
def test_the_nearest_curve_lies_well_inside_the_box(name, rail):
    """So that it is the wrong form that is judged; and it misses the peak of the truth."""
    scenario = build(name, Options(rail=rail, sigma=1e-4))
    method = "ml-exact" if name == "mismatch" else "lm-optimistix"
    estimate = identified(method, scenario, 16)
    assert np.all(np.asarray(estimate.status) == Status.TRUSTED)
    low, high = np.asarray(scenario.known.lower), np.asarray(scenario.known.upper)
    names = scenario.known.curve.free
    found = np.array([np.mean(np.asarray(estimate.values[n])) for n in names])
    assert np.all(found > low + 0.02 * (high - low))
    assert np.all(found < high - 0.2 * (high - low))
    # No other parameters near by do better on the clean curve.
    slip = scenario.excitation.slips()
    clean = np.asarray(scenario.rail.adhesion(slip, {}))

    def misfit(values):
        curve = with_free_values(scenario.known.curve, jnp.asarray(values))
        return np.sum((np.asarray(curve(slip, {})) - clean) ** 2)

    least, rng = misfit(found), np.random.default_rng(0)
    for _ in range(40):
        assert misfit(found * (1 + 0.02 * rng.normal(size=found.size))) > least
    slip_opt = float(scenario.quantities()["slip_opt"][0])
    assert abs(float(np.mean(np.asarray(estimate.values["slip_opt"]))) / slip_opt - 1) > 0.05


def test_who_takes_a_mismatch():
    def takers(name):
        known = build(name).known
        return {n for n, method in IDENTIFIERS.items() if method.accepts(known) is None}

    burckhardt, kiencke = takers("mismatch"), takers("mismatch-kiencke")
    assert burckhardt == takers("single") == takers("coloured")
    assert {"ml-exact", "ml-pooled", "ml-de-robust", "lm-jaxopt"} <= burckhardt
    assert {"ls-kiencke", "rls-kiencke", "qp-qian2024-1", "lm-jaxopt"} <= kiencke


@pytest.mark.parametrize("name", ["coloured", *MISMATCHES])
def test_options_that_do_not_fit_are_refused_by_name(name):
    with pytest.raises(InputError, match="--blocks"):
        build(name, Options(blocks=2))
    with pytest.raises(InputError, match="--rail icy") as refused:
        build(name, Options(rail="icy"))
    assert str(refused.value).endswith(".")
    if name in MISMATCHES:
        with pytest.raises(InputError, match=r"--rail common .* dry, wet"):
            build(name, Options(rail="common"))
