"""The noise of runs against dense covariance matrices, and what is made of it."""

import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest
from scipy.optimize import minimize
from scipy.stats import kstest, multivariate_normal

from adhesion_jax.curves import CURVES
from adhesion_jax.curves.burckhardt import Burckhardt
from adhesion_jax.measured import points as points_module
from adhesion_jax.measured.answer import _mixture, predictive_weights
from adhesion_jax.measured.comparison import compared
from adhesion_jax.measured.fit import fitted
from adhesion_jax.measured.identification import fit_curves
from adhesion_jax.measured.noise import Allowed, RunNoise, estimated, left_out
from adhesion_jax.measured.points import arranged, misfit_functions, products
from adhesion_jax.measured.slip import exact
from adhesion_jax.measured.start import least_squares, parameters_at, stretch_at
from adhesion_jax.records import Record

TRUTH = Burckhardt(c1=0.35, c2=60.0, c3=0.5)
SHARE = np.array([np.log(350.0) / np.log(2000.0), np.log(120.0) / np.log(10000.0), 0.1])


def ar1(r, shape, generator):
    noise = generator.standard_normal(shape)
    for k in range(1, shape[1]):
        noise[:, k] = r * noise[:, k - 1] + np.sqrt(1 - r**2) * noise[:, k]
    return noise


def record_of_runs(runs, samples, r, scatter, seed, slip_noise=0.0, levels=None):
    generator = np.random.default_rng(seed)
    half = np.linspace(0.002, 0.15, samples // 2)
    slip = np.tile(np.concatenate([half, half[::-1]]), (runs, 1))
    level = 1 + scatter * generator.standard_normal((runs, 1))
    level = level if levels is None else level * np.reshape(levels, (-1, 1))
    adhesion = level * np.asarray(TRUTH(jnp.asarray(slip), {}))
    adhesion += 0.01 * ar1(r, slip.shape, generator)
    slip = slip + slip_noise * generator.standard_normal(slip.shape)
    every = jnp.ones(slip.size, dtype=bool)
    time = jnp.asarray(np.tile(np.arange(samples) / 10.0, runs))
    columns = {"time_s": time}
    record = Record(jnp.asarray(slip.ravel()), jnp.asarray(adhesion.ravel()), every, every, columns)
    return record, np.repeat(np.arange(runs), samples)


class Dense:
    """The model of one small record as matrices of all its points."""

    def __init__(self, points, span):
        slip, theta = points.slip, parameters_at(TRUTH, SHARE)
        c1, c2, c3 = theta
        rise = np.exp(-c2 * slip)
        self.level = c1 * (1 - rise) - c3 * slip
        by_theta = np.stack([1 - rise, c1 * slip * rise, -slip], axis=1)
        self.design = by_theta * stretch_at(TRUTH, SHARE)
        self.functions = misfit_functions(slip, span)
        self.residual = points.adhesion - self.level
        self.run = np.repeat(np.arange(points.runs), np.diff(points.starts))

    def covariance(self, noise):
        apart = np.abs(np.arange(self.run.size)[:, None] - np.arange(self.run.size))
        same = self.run[:, None] == self.run
        found = same * noise.autocorrelation**apart
        found = found + noise.scatter * same * np.outer(self.level, self.level)
        weights = noise.misfit / np.arange(1, 9) ** 3
        return noise.sigma**2 * (found + self.functions * weights @ self.functions.T)

    def restricted_loss(self, noise):
        """Minus the log of the restricted likelihood, less a constant: Harville 1977."""
        whole = self.covariance(noise)
        inverse = np.linalg.inv(whole)
        information = self.design.T @ inverse @ self.design
        best = np.linalg.solve(information, self.design.T @ inverse @ self.residual)
        left = self.residual - self.design @ best
        logs = np.linalg.slogdet(whole)[1] + np.linalg.slogdet(information)[1]
        return 0.5 * (logs + left @ inverse @ left)


@pytest.fixture(scope="module")
def small():
    record, run = record_of_runs(5, 24, 0.6, 0.05, 4)
    points = arranged(record, run, exact(record), ())
    span = points_module.Span(0.3, 0.06, 0.15)
    theta, stretch = parameters_at(TRUTH, SHARE), stretch_at(TRUTH, SHARE)
    found, squares = products(points, TRUTH, theta, stretch, span, np.ones(points.slip.size))
    return points, span, found, squares


def test_the_noise_is_that_of_greatest_restricted_likelihood(small):
    """Beside a dense covariance matrix: no other noise that an optimiser finds is likelier."""
    points, span, found, squares = small
    dense = Dense(points, span)
    assert squares == pytest.approx(np.sum(dense.residual**2), rel=1e-9)
    noise = estimated(found, Allowed(np.ones(3, dtype=bool), True, True), 1e-20, None)
    here = dense.restricted_loss(noise)

    def loss(at):
        return dense.restricted_loss(
            RunNoise(np.exp(at[0]), 0.995 / (1 + np.exp(-at[1])), np.exp(at[2]), np.exp(at[3]))
        )

    for start in ([-4.6, 0.4, 3.0, 0.0], [-4.0, -2.0, 0.0, 4.0], [-5.0, 2.0, 5.0, -6.0]):
        there = minimize(loss, start, method="Nelder-Mead", options={"maxiter": 2000})
        assert here <= there.fun + 2e-3
    assert 0.3 < noise.autocorrelation < 0.9


def test_the_density_of_a_run_given_the_others_is_that_of_one_normal_vector(small):
    points, span, found, _ = small
    dense = Dense(points, span)
    noise = RunNoise(0.011, 0.5, 9.0, 2.0)
    # A wide prior of the parameters, less what it adds to each density.
    wide = 1e5
    whole = dense.covariance(noise) + wide * dense.design @ dense.design.T
    told = left_out(found, noise, np.ones(3, dtype=bool))
    for run in range(points.runs):
        own = dense.run == run
        gain = np.linalg.solve(whole[np.ix_(~own, ~own)], whole[np.ix_(~own, own)])
        mean = dense.residual[~own] @ gain
        spread = whole[np.ix_(own, own)] - whole[np.ix_(own, ~own)] @ gain
        expected = multivariate_normal(mean, spread).logpdf(dense.residual[own])
        assert told[run] == pytest.approx(expected, abs=2e-2)


def test_blocks_of_rows_give_the_sums_of_all_rows(small, monkeypatch):
    points, span, found, squares = small
    theta, stretch = parameters_at(TRUTH, SHARE), stretch_at(TRUTH, SHARE)
    monkeypatch.setattr(points_module, "_BLOCK", 17)
    again, others = products(points, TRUTH, theta, stretch, span, np.ones(points.slip.size))
    assert others == pytest.approx(squares, rel=1e-12)
    for one, other in zip(found, again, strict=True):
        np.testing.assert_allclose(other, one, rtol=1e-9, atol=1e-12)


def test_weights_are_the_ratios_of_the_densities_of_what_was_left_out():
    density = np.array([[-3.0, -4.0, -5.0], [-3.0, -4.0, -5.0], [-4.0, -4.0, -5.0]])
    expected = np.array([1.0, 1.0, np.exp(-1)]) / (2 + np.exp(-1))
    np.testing.assert_allclose(predictive_weights(density), expected)
    # Of many parts the densities themselves would be 0 in numbers of a computer.
    np.testing.assert_allclose(predictive_weights(density - 1e4), expected)


def test_the_interval_of_a_mixture_is_that_of_its_draws():
    parts = [(0.30, 0.004, 12.0, 0.7), (0.32, 0.002, 50.0, 0.3)]
    generator = np.random.default_rng(1)
    counts = generator.multinomial(2_000_000, [0.7, 0.3])
    draws = np.concatenate(
        [
            centre + error * generator.standard_t(degrees, count)
            for (centre, error, degrees, _), count in zip(parts, counts, strict=True)
        ]
    )
    found = _mixture(parts)
    expected = np.quantile(draws, [0.5, 0.025, 0.975])
    np.testing.assert_allclose(found, expected, atol=4e-5)


def test_a_parameter_that_loses_its_influence_on_the_way_is_held():
    curve = CURVES["polach-falling"]
    record, run = record_of_runs(12, 100, 0.0, 0.0, 4)
    slip = record.slip
    rising = 0.3 * slip / (0.02 + slip) + 0.01 * np.random.default_rng(5).normal(size=slip.size)
    speed = {**record.conditions, "vehicle_speed_mps": jnp.full(run.size, 10.0)}
    record = record._replace(adhesion=rising, conditions=speed)
    points = arranged(record, run, exact(record), curve.NEEDS)
    with np.errstate(all="raise"):
        found = fitted(curve, np.array([0.3, 0.98, 0.5, 0.5, 0.5]), points, False)
    a, b = (curve.free.index(name) for name in ("a", "b"))
    assert found.on_bound[a]
    assert found.no_influence[b]
    assert np.isfinite(found.log_density)


def test_noise_in_the_slip_is_found_and_no_longer_moves_the_peak():
    record, run = record_of_runs(12, 200, 0.0, 0.0, 7, slip_noise=0.004)
    peak = TRUTH.peak({})
    naive = fit_curves({"b": TRUTH}, record, run, False, 0.0).curves["b"]
    told = fit_curves({"b": TRUTH}, record, run, False)
    fit = told.curves["b"]
    assert told.slip.low < 0.004 < told.slip.high
    assert abs(fit.peak.adhesion - peak.adhesion) < 3 * fit.mu_max_se
    assert abs(fit.peak.slip - peak.slip) < 3 * fit.slip_opt_se
    # The curve alone at the measured slip is far too low on the rise.
    assert fit.parameters[1] == pytest.approx(60.0, rel=0.05)
    assert abs(naive.parameters[1] - 60.0) > 3 * abs(fit.parameters[1] - 60.0)


def test_an_exact_slip_is_not_called_noisy():
    record, run = record_of_runs(12, 100, 0.5, 0.0, 8)
    assert fit_curves({"b": TRUTH}, record, run, False).slip.sigma < 1e-4


def quick_fit(record, run, start):
    return fitted(TRUTH, start, arranged(record, run, exact(record), ()), False)


def start_without_noise():
    record, _ = record_of_runs(2, 60, 0.0, 0.0, 0)
    return least_squares(TRUTH, record)


def test_a_change_between_groups_of_runs_is_found_and_measured():
    levels = np.repeat([1.0, 0.9], 6)
    record, run = record_of_runs(12, 100, 0.5, 0.01, 9, levels=levels)
    fit = quick_fit(record, run, start_without_noise())
    found = compared(fit, pd.Series(np.repeat(["dry", "damp"], 6)), "rail")
    assert found.p < 1e-4
    table = found.table.set_index("rail")
    peak = float(TRUTH.peak({}).adhesion)
    assert table["mu_max"]["damp"] / table["mu_max"]["dry"] == pytest.approx(0.9, abs=0.02)
    assert table["mu_max_lo"]["dry"] < peak < table["mu_max_hi"]["dry"]
    assert found.run_scatter == pytest.approx(0.01, abs=0.006)


@pytest.mark.slow
@pytest.mark.parametrize(("scatter", "by_run"), [(0.0, True), (0.01, False)])
@pytest.mark.parametrize("r", [0.0, 0.8])
def test_the_p_of_no_change_is_uniform(scatter, by_run, r):
    start, ps = start_without_noise(), []
    labels = pd.Series(np.arange(12) if by_run else np.repeat([0, 1, 2], 4))
    for seed in range(400):
        record, run = record_of_runs(12, 100, r, scatter, 1000 + seed)
        ps.append(compared(quick_fit(record, run, start), labels, "group").p)
    assert kstest(ps, "uniform").pvalue > 1e-3
    # Four binomial standard deviations about 5 %.
    assert np.mean(np.array(ps) < 0.05) == pytest.approx(0.05, abs=0.044)
