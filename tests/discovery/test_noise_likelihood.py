"""The likelihood of the noise against scipy, statsmodels and densities written out."""

import jax
import numpy as np
import pandas as pd
import pytest
import statsmodels.api as sm
from discovery_campaigns import problem_of
from scipy import stats
from scipy.linalg import block_diag, toeplitz
from scipy.optimize import minimize
from statsmodels.tsa.arima.model import ARIMA

from adhesion_jax.discovery.model.fitting import Setting, fit_model, likeliest, own_noise
from adhesion_jax.discovery.model.noise import (
    MODES,
    Noise,
    _half_deviance,
    determinant,
    estimated,
    white_noise,
    whitened,
    whitening,
)

RUNS, POINTS = 6, 9


def noise_of(weight, sigma, autocorrelation, run_scatter, variance=0.0, covariance=0.0):
    shape = np.shape(weight)
    numbers = (np.array(one) for one in (sigma, autocorrelation, run_scatter))
    extra = (np.broadcast_to(one, shape).astype(float) for one in (variance, covariance))
    return Noise(np.asarray(weight, float), *numbers, *extra, np.zeros((*shape, 0)))


def log_densities(noise, level, residual):
    """Of each run, as the package has them."""
    points = np.asarray(noise.weight).sum(axis=1)
    return -np.asarray(halves(noise, level, residual)) - 0.5 * points * np.log(2 * np.pi)


def halves(noise, level, residual):
    whole = whitening(noise, level)
    white = np.asarray(jax.jit(whitened)(whole, residual))
    return 0.5 * (white**2).sum(axis=1) + determinant(whole)


@pytest.fixture(scope="module")
def inside():
    """Runs of several lengths; one with a gap, one with two, one of a point, one of none."""
    there = np.arange(POINTS) < np.array([9, 9, 9, 6, 1, 0])[:, None]
    there[1, 4] = there[2, [0, 3, 4]] = False
    return there


@pytest.fixture(scope="module")
def drawn(inside):
    """A level and a residual; where no point counts they are anything."""
    draw = np.random.default_rng(0)
    level, residual = draw.normal(0.3, 0.1, inside.shape), 0.05 * draw.normal(size=inside.shape)
    return np.where(inside, level, 77.0), np.where(inside, residual, -1e3)


def stretches(there):
    """The numbers of the stretches without a gap, of the points there are."""
    return np.cumsum(np.diff(there.astype(int), prepend=0) == 1)[there]


def markov_covariance(there, variance, neighbours):
    """Of points each of which depends on the one before alone, and across a gap on none."""
    kept, stretch = np.flatnonzero(there), stretches(there)
    found = np.diag(variance[there])
    for i, late in enumerate(kept):
        for j, early in enumerate(kept[:i]):
            if stretch[i] == stretch[j]:
                between = np.arange(early + 1, late + 1)
                shares = neighbours[between] / variance[between - 1]
                found[i, j] = found[j, i] = variance[early] * np.prod(shares)
    return found


def dense(noise, level, there, covariance, residual):
    """The log density of one run by scipy, with the level of the run beside a covariance."""
    if not there.any():
        return 0.0
    whole = covariance + float(noise.run_scatter) ** 2 * np.outer(level[there], level[there])
    return stats.multivariate_normal(cov=whole).logpdf(residual[there])


@pytest.mark.parametrize("autocorrelation", [0.0, 0.4, 0.97])
@pytest.mark.parametrize("run_scatter", [0.0, 0.02, 3.0])
def test_noise_in_time_with_levels_of_runs_has_its_normal_density(
    inside, drawn, autocorrelation, run_scatter
):
    noise = noise_of(inside, 0.05, autocorrelation, run_scatter)
    level, residual = drawn
    expected = []
    for row, there in enumerate(inside):
        place = np.flatnonzero(there)
        stretch = stretches(there)
        apart = np.abs(place[:, None] - place)
        together = stretch[:, None] == stretch
        stationary = np.where(together, 0.05**2 * autocorrelation**apart, 0.0)
        expected.append(dense(noise, level[row], there, stationary, residual[row]))
    np.testing.assert_allclose(log_densities(noise, level, residual), expected, rtol=1e-10)


@pytest.mark.parametrize("run_scatter", [0.0, 0.3])
def test_variances_of_their_own_have_their_normal_density(inside, drawn, run_scatter):
    level, residual = drawn
    variance = np.random.default_rng(1).exponential(0.05**2, inside.shape)
    noise = noise_of(inside, 0.02, 0.0, run_scatter, variance)
    expected = [
        dense(noise, level[row], there, np.diag(0.02**2 + variance[row, there]), residual[row])
        for row, there in enumerate(inside)
    ]
    np.testing.assert_allclose(log_densities(noise, level, residual), expected, rtol=1e-10)


@pytest.fixture(scope="module")
def uneven(inside):
    """Errors of the slip that differ from point to point, and those of neighbours alike."""
    draw = np.random.default_rng(2)
    variance = draw.exponential(0.04**2, inside.shape)
    alike = draw.uniform(-0.8, 0.8, inside.shape)
    covariance = np.zeros(inside.shape)
    covariance[:, 1:] = alike[:, 1:] * np.sqrt(variance[:, 1:] * variance[:, :-1])
    return variance, covariance


def test_a_chain_has_the_product_of_its_conditional_densities(inside, drawn, uneven):
    level, residual = drawn
    noise = noise_of(inside, 0.03, 0.6, 0.0, *uneven)
    own, neighbours = 0.03**2 + uneven[0], 0.6 * 0.03**2 + uneven[1]
    expected = np.zeros(RUNS)
    for row, there in enumerate(inside):
        for t in np.flatnonzero(there):
            mean, variance = 0.0, own[row, t]
            if t and there[t - 1]:
                share = neighbours[row, t] / own[row, t - 1]
                mean = share * residual[row, t - 1]
                variance -= share * neighbours[row, t]
            expected[row] += stats.norm.logpdf(residual[row, t], mean, np.sqrt(variance))
    np.testing.assert_allclose(log_densities(noise, level, residual), expected, rtol=1e-10)


@pytest.mark.parametrize("slow", [False, True], ids=["fast", "with slow modes"])
@pytest.mark.parametrize("run_scatter", [0.0, 0.05, 2.0])
def test_a_chain_with_levels_of_runs_has_its_normal_density(
    inside, drawn, uneven, run_scatter, slow
):
    level, residual = drawn
    noise = noise_of(inside, 0.03, 0.6, run_scatter, *uneven)
    own, neighbours = 0.03**2 + uneven[0], 0.6 * 0.03**2 + uneven[1]
    if slow:
        draw = np.random.default_rng(3)
        noise = noise._replace(modes=0.05 * draw.normal(size=(*inside.shape, MODES)))
    expected = []
    for row, there in enumerate(inside):
        covariance = markov_covariance(there, own[row], neighbours[row])
        modes = noise.modes[row, there]
        expected.append(
            dense(noise, level[row], there, covariance + modes @ modes.T, residual[row])
        )
    np.testing.assert_allclose(log_densities(noise, level, residual), expected, rtol=1e-10)
    # What is searched is the same likelihood.
    points = inside.sum()
    kept = np.where(inside, residual, 0.0), np.where(inside, level, 0.0)
    searched = -_half_deviance(noise, *kept) - 0.5 * points * np.log(2 * np.pi)
    assert searched == pytest.approx(sum(expected), rel=1e-10)


def campaign(runs, points, sigma, autocorrelation, run_scatter, seed, extra=False):
    """A residual drawn from its noise, and what is known of that before it is estimated."""
    draw = np.random.default_rng(seed)
    there = np.arange(points) < np.where(np.arange(runs) % 3, points, points - points // 3)[:, None]
    level = 0.3 + 0.1 * draw.random((runs, points))
    variance = draw.exponential(4 * sigma**2, (runs, points)) * extra * (draw.random(points) < 0.3)
    covariance = np.zeros_like(variance)
    covariance[:, 1:] = 0.3 * np.sqrt(variance[:, 1:] * variance[:, :-1])
    own, neighbours = sigma**2 + variance, autocorrelation * sigma**2 + covariance
    residual = np.zeros((runs, points))
    for row in range(runs):
        residual[row, 0] = np.sqrt(own[row, 0]) * draw.standard_normal()
        for t in range(1, points):
            share = neighbours[row, t] / own[row, t - 1]
            fresh = np.sqrt(own[row, t] - share * neighbours[row, t])
            residual[row, t] = share * residual[row, t - 1] + fresh * draw.standard_normal()
    residual += run_scatter * draw.standard_normal((runs, 1)) * level
    start = white_noise(there.astype(float), 0.1)._replace(
        variance=variance * there, covariance=covariance * there
    )
    return start, np.where(there, residual, 1e3), level


def loss_of(noise, level, residual):
    return -float(log_densities(noise, level, residual).sum())


CASES = [(0.01, 0.5, 0.03), (0.02, 0.0, 0.0), (0.005, 0.9, 0.2), (0.01, 0.2, 0.002)]


@pytest.mark.parametrize("extra", [False, True])
@pytest.mark.parametrize(("sigma", "autocorrelation", "run_scatter"), CASES)
def test_the_estimate_has_the_greatest_likelihood(sigma, autocorrelation, run_scatter, extra):
    start, residual, level = campaign(20, 40, sigma, autocorrelation, run_scatter, 3, extra)
    found = estimated(start, residual, level, True, True)
    np.testing.assert_array_equal(found.variance, start.variance)
    np.testing.assert_array_equal(found.covariance, start.covariance)
    least = loss_of(found, level, residual)
    # The grid ends so fine; with errors of the slip the search ends where a step gains a hundredth.
    slack = 0.02 if extra else 1e-3
    draw = np.random.default_rng(4)
    for size in (0.003, 0.03, 0.3):
        for _ in range(25):
            steps = size * draw.standard_normal(3)
            other = found._replace(
                sigma=found.sigma * np.exp(steps[0]),
                autocorrelation=np.clip(found.autocorrelation + steps[1], 0.0, 0.99),
                run_scatter=np.abs(found.run_scatter * np.exp(steps[2]) + 0.01 * steps[1]),
            )
            assert loss_of(other, level, residual) > least - slack

    # And nothing better is found from the truth.
    def loss(at):
        return loss_of(
            found._replace(
                sigma=np.exp(at[0]), autocorrelation=np.abs(np.tanh(at[1])), run_scatter=abs(at[2])
            ),
            level,
            residual,
        )

    best = minimize(
        loss,
        (np.log(sigma), np.arctanh(autocorrelation), run_scatter),
        method="Nelder-Mead",
        options={"fatol": 1e-5, "xatol": 1e-5},
    )
    assert best.fun > least - slack


def test_noise_beside_errors_of_the_slip_is_recovered():
    runs, points, truth = 120, 60, (0.01, 0.5, 0.05)
    start, residual, level = campaign(runs, points, *truth, 5, extra=True)
    found = estimated(start, residual, level, True, True)
    # Three standard errors, of the points whose slip is as good as exact, about two thirds.
    count = 0.66 * start.weight.sum()
    assert float(found.sigma) == pytest.approx(truth[0], rel=3 * np.sqrt(1.25 / 0.75 / 2 / count))
    assert float(found.autocorrelation) == pytest.approx(truth[1], abs=3 * np.sqrt(0.75 / count))
    assert float(found.run_scatter) == pytest.approx(truth[2], rel=3 / np.sqrt(2 * runs))
    # As if the slip were exact there would be too much noise.
    plain = estimated(white_noise(start.weight, 0.1), residual, level, True, True)
    assert float(plain.sigma) > 1.2 * float(found.sigma)


def test_points_in_no_order_have_no_correlation_and_blocks_no_level():
    start, residual, level = campaign(20, 40, 0.01, 0.8, 0.1, 6)
    assert float(estimated(start, residual, level, False, True).autocorrelation) == 0
    assert float(estimated(start, residual, level, True, False).run_scatter) == 0


def test_a_series_has_the_likelihood_that_arima_finds():
    draw = np.random.default_rng(7)
    series = np.zeros(400)
    for t in range(400):
        series[t] = 0.7 * series[t - 1] * (t > 0) + 0.01 * draw.standard_normal()
    series += 0.3
    model = ARIMA(100 * series, order=(1, 0, 0), trend="c").fit()
    mean, r, variance = model.params
    mean, fresh = mean / 100, np.sqrt(variance) / 100
    residual, level = (series - mean)[None], np.full((1, 400), mean)
    found = estimated(white_noise(np.ones((1, 400)), 0.1), residual, level, True, True)
    assert float(found.autocorrelation) == pytest.approx(r, abs=1e-3)
    assert float(found.sigma) == pytest.approx(fresh / np.sqrt(1 - r**2), rel=1e-3)
    told = model.llf + 400 * np.log(100)
    assert -loss_of(found, level, residual) == pytest.approx(told, abs=1e-3)


def test_levels_of_runs_are_those_of_a_mixed_model():
    draw, runs, points = np.random.default_rng(8), 30, 25
    value = (
        0.3 + 0.012 * draw.standard_normal((runs, 1)) + 0.02 * draw.standard_normal((runs, points))
    )
    groups = np.repeat(np.arange(runs), points)
    # In units of which the optimiser of the other is sure.
    model = sm.MixedLM(100 * value.ravel(), np.ones(value.size), groups).fit(reml=False)
    mean = float(model.fe_params[0]) / 100
    level = np.full((runs, points), mean)
    start = white_noise(np.ones((runs, points)), 0.1)
    found = estimated(start, value - mean, level, False, True)
    assert float(found.sigma) == pytest.approx(np.sqrt(model.scale) / 100, rel=1e-3)
    scatter = np.sqrt(model.cov_re.item()) / 100
    assert float(found.run_scatter) * mean == pytest.approx(scatter, rel=2e-3)
    told = model.llf + value.size * np.log(100)
    assert -loss_of(found, level, value - mean) == pytest.approx(told, abs=1e-3)


@pytest.mark.thorough
def test_a_level_is_fitted_as_by_generalised_least_squares():
    draw, runs, points = np.random.default_rng(9), 17, 100
    error = np.zeros((runs, points))
    for t in range(points):
        fresh = (1.0 if t == 0 else 0.8) * draw.standard_normal(runs)
        error[:, t] = (0.6 * error[:, t - 1] if t else 0.0) + fresh
    # More points low than high at the ends, which an unweighted mean would count alike.
    table = pd.DataFrame(
        {
            "run": np.repeat(np.arange(runs), points),
            "slip_ratio": 0.02,
            "adhesion": 0.3 + 0.01 * error.ravel(),
            "wear": draw.random(runs * points),
        }
    )
    problem = problem_of(table)
    adhesion = np.asarray(problem.data.adhesion)
    white = Setting(problem, white_noise(problem.points, 0.01), adhesion)
    setting = own_noise(likeliest(white, "level", (0.25,), ()))
    setting = setting._replace(
        noise=estimated(setting.noise, adhesion - setting.level, setting.level, True, False)
    )
    fitted = fit_model(setting, "level", (0.25,), ())
    r, sigma = float(setting.noise.autocorrelation), float(setting.noise.sigma)
    assert r > 0.5
    correlation = block_diag(*[toeplitz(r ** np.arange(points))] * runs)
    model = sm.GLS(adhesion.ravel(), np.ones(adhesion.size), sigma=correlation).fit()
    assert fitted.base_values[0] == pytest.approx(model.params[0], rel=1e-9)
    assert fitted.base_values[0] != pytest.approx(adhesion.mean(), rel=1e-6)
    error = 1 / np.sqrt(fitted.hessian.sum())
    unbiased = model.bse[0] * np.sqrt((adhesion.size - 1) / adhesion.size)
    assert error == pytest.approx(unbiased, rel=1e-4)
    assert sigma**2 == pytest.approx(model.ssr / adhesion.size, rel=1e-4)
    told = -fitted.total - 0.5 * adhesion.size * np.log(2 * np.pi)
    assert told == pytest.approx(model.llf, abs=1e-3)
