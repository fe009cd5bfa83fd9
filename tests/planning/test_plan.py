"""A plan against dense linear algebra, finite differences, simulation, and properties."""

import dataclasses

import numpy as np
import pytest
from scipy.linalg import block_diag, toeplitz
from simulated_measurements import check_plan

import adhesion_jax as aj
from adhesion_jax.curves import CURVES
from adhesion_jax.curves.bent import Bent
from adhesion_jax.effects.conditions import Calendar
from adhesion_jax.effects.law import CorrectedLaw
from adhesion_jax.effects.slip_velocity import Speed
from adhesion_jax.errors import InputError
from adhesion_jax.inference.noise import RunNoise
from adhesion_jax.planning.plan import (
    ROUGH,
    Again,
    Planner,
    Sweeps,
    again,
    information_under,
)
from adhesion_jax.planning.truth import Truth, peak_of, sensitivity_of
from adhesion_jax.report.plan import worth
from adhesion_jax.scenarios.rails import RAILS
from adhesion_jax.scenarios.rails import peak_of as peak_in_closed_form
from experiments.campaigns.simulator import noise_of_runs

COMMON = Truth(RAILS["common"], {})
NOISES = {
    "white": RunNoise(0.01),
    "autocorrelated": RunNoise(0.01, autocorrelation=0.9),
    "scattered runs": RunNoise(0.01, autocorrelation=0.5, run_scatter=0.02),
    "slow level": RunNoise(0.01, slow_level=0.03, slow_rows=40),
    "noise in slip": RunNoise(0.01, slip_noise=0.003),
    "all": RunNoise(0.01, 0.95, 0.02, 0.03, 40, 0.003),
}


def adhesion(slip, c1, c2, c3):
    """Burckhardt's curve, written afresh."""
    return c1 * (1 - np.exp(-c2 * slip)) - c3 * slip


def by_differences(slip):
    """Derivatives of the common rail's adhesion by its parameters, and by the slip."""
    rail = np.array([float(getattr(RAILS["common"], name)) for name in ("c1", "c2", "c3")])
    columns = []
    for place in range(3):
        step = np.zeros(3)
        step[place] = 1e-5 * rail[place]
        change = adhesion(slip, *(rail + step)) - adhesion(slip, *(rail - step))
        columns.append(change / (2 * step[place]))
    slope = (adhesion(slip + 1e-6, *rail) - adhesion(slip - 1e-6, *rail)) / 2e-6
    return np.stack(columns), slope, adhesion(slip, *rail)


def covariance(noise, slope, level):
    """Of one run, from the definition of the noise."""
    lag = np.arange(slope.size)
    levels = noise.run_scatter**2 * np.ones((lag.size, lag.size))
    if noise.slow_level:
        levels += noise.slow_level**2 * toeplitz(np.exp(-lag / noise.slow_rows))
    ar = noise.sigma**2 * toeplitz(noise.autocorrelation**lag)
    return ar + np.diag((noise.slip_noise * slope) ** 2) + levels * np.outer(level, level)


def sandwich(noise, sensitivity, slope, of_noise):
    """Curvature and covariance of the score, of weights by sigma and the noise of the slip."""
    weighted = sensitivity / (noise.sigma**2 + (noise.slip_noise * slope) ** 2)
    return weighted @ sensitivity.T, weighted @ of_noise @ weighted.T


@pytest.mark.parametrize("name", NOISES)
def test_the_information_is_that_of_the_whole_covariance(name):
    """Of three runs of unequal length, one of a single sample, against dense matrices."""
    slips = [np.linspace(0.0, 0.4, 60), np.array([0.1]), np.linspace(-0.3, 0.2, 23)]
    slip = np.concatenate(slips)
    blocks = []
    for run in slips:
        _, slope, level = by_differences(np.abs(run))
        blocks.append(covariance(NOISES[name], slope, np.sign(run) * level))
    sensitivity = np.sign(slip) * by_differences(np.abs(slip))[0]
    slope = by_differences(np.abs(slip))[1]
    expected = sandwich(NOISES[name], sensitivity, slope, block_diag(*blocks))
    starts = np.array([0, 60, 61])
    found = information_under(NOISES[name], sensitivity_of(COMMON, slip), starts)
    for part, dense in zip(found, expected, strict=True):
        np.testing.assert_allclose(part, dense, rtol=1e-6)


@pytest.mark.parametrize("name", NOISES)
def test_what_is_drawn_has_the_covariance_of_the_noise(name):
    """Every element within 5.5 standard errors of the sample covariance of normal draws."""
    noise, draws = NOISES[name], 4000
    _, slope, level = by_differences(np.linspace(0.0, 0.4, 60))
    made = noise_of_runs(noise, np.tile(level, (draws, 1)), np.random.default_rng(0))
    true = covariance(noise._replace(slip_noise=0.0), slope, level)
    error = np.sqrt((np.outer(np.diag(true), np.diag(true)) + true**2) / draws)
    assert np.all(np.abs(made.T @ made / draws - true) < 5.5 * error)


def test_the_errors_of_the_peak_follow_from_its_closed_form():
    """The delta method by finite differences of the closed form of the peak."""
    rail, noise = RAILS["common"], NOISES["autocorrelated"]
    gradient = []
    for name in ("c1", "c2", "c3"):
        value = float(getattr(rail, name))
        ends = [
            np.array(peak_in_closed_form(dataclasses.replace(rail, **{name: value * (1 + step)})))
            for step in (1e-5, -1e-5)
        ]
        gradient.append((ends[0] - ends[1]) / (2e-5 * value))
    slip_opt, mu_max = peak_in_closed_form(rail)
    sensitivity, slope, level = by_differences(np.linspace(0.0, 0.3, 200))
    curvature, score = sandwich(noise, sensitivity, slope, covariance(noise, slope, level))
    along = np.linalg.solve(curvature, np.array(gradient))
    of_slip, of_level = np.sqrt(np.diag(along.T @ score @ along) / 5)
    found = Planner(COMMON, noise, Sweeps(200)).errors(np.array([0.3]), 1000.0)
    np.testing.assert_allclose(found[0], [of_level / mu_max, of_slip / slip_opt], rtol=1e-4)


def test_the_truth_is_differentiated_at_any_number_of_slips():
    slip = np.linspace(0.0, 1.0, 5000)
    sensitivity = sensitivity_of(COMMON, slip)
    by_parameters, slope, level = by_differences(slip)
    np.testing.assert_allclose(sensitivity.adhesion, level, atol=1e-14)
    np.testing.assert_allclose(sensitivity.slope[1:], slope[1:], rtol=1e-6)
    np.testing.assert_allclose(sensitivity.by_parameters, by_parameters, rtol=1e-6, atol=1e-9)


def test_four_times_as_many_runs_halve_every_error_and_more_noise_never_helps():
    slips = np.geomspace(0.1, 0.8, 6)
    for noise in NOISES.values():
        found = Planner(COMMON, noise, Sweeps(200)).plan(slips, np.array([400.0, 1600.0]))
        np.testing.assert_allclose(found.errors[:, 0], 2 * found.errors[:, 1], rtol=1e-9)
    quiet = Planner(COMMON, NOISES["white"], Sweeps(200)).errors(slips, 400.0)
    blurred = Planner(COMMON, RunNoise(0.01, slip_noise=0.001), Sweeps(200)).errors(slips, 400.0)
    assert np.all(blurred > quiet)
    # Levels of runs add their own variance to mu_max, and leave the slip of the peak alone.
    scattered = RunNoise(0.01, run_scatter=0.01)
    level = Planner(COMMON, scattered, Sweeps(200)).errors(slips, 400.0)
    np.testing.assert_allclose(level[:, 1], quiet[:, 1], rtol=1e-6)
    np.testing.assert_allclose(level[:, 0] ** 2, quiet[:, 0] ** 2 + 0.01**2 / 2, rtol=1e-6)
    # Doubled noise doubles every error.
    doubled = Planner(COMMON, RunNoise(0.02), Sweeps(200)).errors(slips, 400.0)
    np.testing.assert_allclose(doubled, 2 * quiet, rtol=1e-9)


def test_parameters_that_the_slips_cannot_tell_apart_leave_the_peak_undetermined():
    """At slips so small that the curve is a straight line, only its slope is seen."""
    errors = Planner(COMMON, NOISES["white"], Sweeps(200)).errors(np.array([1e-9, 0.3]), 400.0)
    assert np.all((errors[0] > 1e3) | np.isinf(errors[0]))
    assert np.all(errors[1] < 0.1)
    two = aj.Kiencke(a0=40.0, p1=100.0, p2=500.0, free=("p1", "p2"))
    at_zero = Planner(Truth(two, {}), NOISES["white"], Again(np.zeros(20), np.zeros(1, int), 20))
    assert np.all(np.isinf(at_zero.errors(np.array([0.3]), 400.0)))


def test_the_fewest_samples_reach_the_wanted_error_and_one_fewer_does_not():
    chosen = Planner(COMMON, NOISES["white"], again(np.linspace(0.0, 1.0, 50), np.zeros(1, int)))
    slips = np.array([0.15, 0.3, 0.6])
    wanted = chosen.wanted(slips, 0.002)
    enough = chosen.errors(slips, wanted.samples)
    fewer = chosen.errors(slips, wanted.samples - 1)
    assert np.all(enough <= [0.002, ROUGH])
    assert np.all(np.any(fewer > [0.002, ROUGH], axis=1))
    assert wanted.cheapest <= wanted.samples.min()
    best = chosen.errors(np.array([wanted.cheapest_slip]), wanted.cheapest)[0]
    assert best[0] <= 0.002


def test_the_slip_that_halves_the_interval_does():
    slip = np.linspace(0.0, 0.15, 150)
    chosen = Planner(COMMON, RunNoise(0.01, 0.8), again(slip, np.array([0, 75])))
    present = chosen.present(0.15, 150, 2)
    for quantity, further in enumerate(present.further):
        assert further is not None
        at = chosen.errors(np.array([further, 0.97 * further]), 150.0)[:, quantity]
        assert at[0] <= present.errors[quantity] / 2 < at[1]
    reached = chosen.present(0.6, 150, 2)
    assert reached.further[0] is None


def test_sweeps_divide_the_samples_into_runs_from_zero_to_the_largest_slip():
    for samples, runs, size in ((100.0, 1, 100), (200.0, 1, 200), (800.0, 4, 200), (700.0, 4, 175)):
        excitation = Sweeps(200)(samples)
        assert (excitation.runs, excitation.share.size) == (runs, size)
        assert (excitation.share[0], excitation.share[-1]) == (0.0, 1.0)


@pytest.mark.thorough
@pytest.mark.parametrize(
    "noise",
    [
        RunNoise(0.01, 0.9, run_scatter=0.02),
        RunNoise(0.01, 0.5, slow_level=0.03, slow_rows=100),
        RunNoise(0.01, 0.5, slip_noise=0.0005),
    ],
    ids=["correlated", "slow level", "noisy slip"],
)
def test_simulated_measurements_scatter_as_planned(noise):
    """Six cells: the ratio of the standard errors within 5 %, or four of its standard errors."""
    slips, numbers = np.geomspace(0.35, 0.7, 3), np.array([400.0, 1600.0])
    chosen = Planner(COMMON, noise, Sweeps(200)).plan(slips, numbers)
    cells = check_plan(chosen, 1000, seed=4)
    assert len(cells) >= 5
    assert cells["failed"].sum() <= 5
    assert (abs(cells["ratio"] - 1) < np.maximum(0.05, 4 * cells["ratio_se"])).all(), cells
    # A bias of at most a third of a standard error, known to a thirtieth.
    assert (abs(cells["bias"]) < 1 / 3 + 4 / np.sqrt(1000)).all(), cells


def law_with_speed():
    curve, speed = RAILS["common"], Speed(k=1.0, reference=10.0)
    ranges = {"vehicle_speed_mps": (5.0, 35.0)}
    return CorrectedLaw(curve, (speed,), ranges, Calendar("time_s", 0.0, 1.0))


def test_a_law_with_a_departure_is_planned_about_its_own_peak():
    """By the envelope theorem the gradient of mu_max is that of the law at the slip of the peak."""
    bent = Bent(RAILS["common"], np.array([0.1, -0.05]), 0.02, 0.4)
    found = peak_of(Truth(CorrectedLaw(bent, (), {}, Calendar("time_s", 0.0, 1.0)), {}))
    slip = np.linspace(0.0, 1.0, 100_001)
    law = np.asarray(bent(slip))
    assert found.slip_opt == pytest.approx(slip[law.argmax()], abs=1e-5)
    assert found.mu_max == pytest.approx(law.max(), rel=1e-8)
    columns, _, plain = by_differences(np.array([found.slip_opt]))
    np.testing.assert_allclose(
        found.gradient[0], columns[:, 0] * found.mu_max / plain[0], rtol=1e-5
    )


@pytest.mark.thorough
def test_a_saved_law_without_ranges_is_planned_under_the_conditions_that_are_stated():
    """As `identify` saves one: its curve may need a column of which the file has no range."""
    curve, size = CURVES["polach-falling"], {"largest_slips": (0.05, 0.1), "samples": (200, 800)}
    law = CorrectedLaw(curve, (), {}, Calendar("run_order", 0.0, 1.0))
    with pytest.raises(InputError, match="depends on vehicle_speed_mps, whose value is not given"):
        aj.plan(law)
    at = {"conditions": {"vehicle_speed_mps": 10.0}}
    found, alone = aj.plan(law, **at, **size), aj.plan(curve, **at, **size)
    np.testing.assert_allclose(found.plan.errors, alone.plan.errors, rtol=1e-6)


@pytest.mark.thorough
def test_a_law_with_effects_is_planned_at_its_conditions():
    """What takes a share of the adhesion makes the same noise larger by as much."""

    def fall(speed_mps):  # Curtius and Kniffler
        return 7.5 / (44 + 3.6 * speed_mps) + 0.161

    size = {"largest_slips": (0.2, 0.4), "samples": (200, 800)}
    left = fall(30.0) / fall(10.0)
    found = aj.plan(law_with_speed(), conditions={"vehicle_speed_mps": 30.0}, sigma=0.01, **size)
    plain = aj.plan("common", sigma=0.01 / left, **size)
    np.testing.assert_allclose(found.plan.errors, plain.plan.errors, rtol=1e-5)
    assert found.plan.planner.peak.mu_max == pytest.approx(
        left * plain.plan.planner.peak.mu_max, rel=1e-9
    )
    # Otherwise conditions are in the middle of their ranges, 20 m/s.
    middle = aj.plan(law_with_speed(), **size).plan.planner.peak.mu_max
    assert middle == pytest.approx(fall(20.0) / fall(10.0) * 0.29847189346, rel=1e-9)


@pytest.mark.parametrize(
    ("source", "options", "says"),
    [
        ("icy", {}, "--rail icy is unknown"),
        ("dry", {"sigma": 0.0}, "sigma is a number from 1e-09 to 10, not 0"),
        ("dry", {"autocorrelation": 1.0}, "autocorrelation is a number from 0 to 1, not 1"),
        ("dry", {"run_scatter": np.nan}, "run_scatter is a number"),
        ("dry", {"slow_level": 0.03}, "slow_level is stated without slow_rows"),
        ("dry", {"slow_rows": 100.0}, "slow_rows is stated without slow_level"),
        ("dry", {"samples": [5, 20]}, "two or more from 10 to"),
        ("dry", {"samples": [100]}, "two or more from 10 to"),
        ("dry", {"largest_slips": [0.1, 1.5]}, "between 0 and 1, where the peak is searched"),
        ("dry", {"samples_per_run": 1}, "samples_per_run is 2 or more"),
        ("dry", {"want": 1.0}, "want is a share of mu_max"),
        ("dry", {"conditions": {"vehicle_speed_mps": 5.0}}, "is no condition of the law"),
        (CURVES["polach"], {}, "has no peak between slip 0 and 1"),
        (CURVES["polach-falling"], {}, "depends on vehicle_speed_mps, whose value is not given"),
    ],
)
def test_what_cannot_be_planned_is_refused_in_one_sentence(source, options, says):
    with pytest.raises(InputError) as refused:
        aj.plan(source, **options)
    assert says in str(refused.value)


def test_a_condition_outside_the_range_of_a_law_is_refused():
    with pytest.raises(InputError, match="from 5 to 35, and says nothing of 50"):
        aj.plan(law_with_speed(), conditions={"vehicle_speed_mps": 50.0})


def test_a_slow_level_is_told_and_costs():
    size = {"largest_slips": (0.2, 0.4), "samples": (400, 800)}
    found = aj.plan("common", slow_level=0.03, slow_rows=100.0, **size)
    said = " ".join(found.verdict.split())
    assert "varies within a run by 3.0 % of the adhesion, with a correlation" in said
    assert "falls to 1/e after 100 samples" in said
    assert np.all(found.plan.errors > aj.plan("common", **size).plan.errors)


def test_what_a_figure_is_worth_is_told():
    found = aj.plan("common", largest_slips=(0.05, 0.1, 0.4), samples=(100, 10000))
    table = found.table.set_index(["largest_slip", "samples"])
    assert table["slip_opt"][0.05, 100] == "not determined"
    assert table["mu_max"][0.4, 10000] == "determined"
    rough = table["slip_opt_relative_se"].between(ROUGH, 1.0)
    assert (table["slip_opt"][rough] == "rough").all()
    assert list(table["peak_beyond_slips"]) == [True] * 4 + [False] * 2
    said = found.verdict
    for part in (
        "n.d.: not determined",
        "In parentheses: slip_opt",
        "extrapolate",
        "mu_max 0.2985",
    ):
        assert part in said


def test_a_figure_is_rough_where_slip_opt_is_known_to_no_better_than_ten_per_cent():
    """As docs/plan.md says: up to there small errors have scattered as planned."""
    assert [worth(0.01, error) for error in (0.098, 0.102)] == ["determined", "rough"]
