"""What is told of the signals and their noise, and of what few runs cannot show."""

import numpy as np
import pandas as pd
import pytest
from discovery_campaigns import (
    POINTS,
    RUNS,
    TRUE,
    campaign,
    curve,
    noise,
    problem_of,
    runs_of,
    setting_of,
)

from adhesion_jax.discovery.engine import _few_runs, _on_course
from adhesion_jax.discovery.findings.found import slip_noise_found
from adhesion_jax.discovery.findings.summary import law_of
from adhesion_jax.discovery.model.bases import best_alone
from adhesion_jax.discovery.model.course import as_measured
from adhesion_jax.discovery.model.echoes import echoes
from adhesion_jax.discovery.model.fitting import nearly_fitted, weighed
from adhesion_jax.discovery.model.noise import left_by, noise_of, slip_noise_of
from adhesion_jax.discovery.model.rows import predicted
from adhesion_jax.discovery.search.state import Selection
from adhesion_jax.discovery.types import Errors, Interval


def fitted_to(table, spread=0.0):
    setting = setting_of(table, spread=spread)
    fitted = nearly_fitted(setting, "burckhardt", TRUE, ())
    return nearly_fitted(weighed(fitted), "burckhardt", fitted.base_values.tolist(), ())


def drawn(seed, jumps=0.0, acts=True):
    """A campaign of white noise; the slip jumps about its course, measured so or truly so."""
    draw = np.random.default_rng(seed)
    table = campaign(draw)
    jumping = table["slip_ratio"] + jumps * draw.normal(size=len(table))
    true = table["slip_ratio"] if acts else jumping
    error = noise(draw, sigma=0.004, correlation=0.0)
    return table.assign(slip_ratio=jumping, adhesion=curve(true) + error)


def test_a_column_computed_from_a_signal_echoes_it_and_a_cause_does_not():
    """A torque has the noise of adhesion, a drum's speed that of slip, a gust that acts none."""
    draw = np.random.default_rng(3)
    table = drawn(3, 0.001)
    adhesion = table["adhesion"] * np.exp(0.05 * table["gust"])
    speed = 12 + 0.1 * table["load"]
    table = table.assign(
        adhesion=adhesion,
        drive_Nm=4e3 * adhesion + 10 * draw.normal(size=len(table)),
        vehicle_speed_mps=speed,
        drum_mps=speed * (1 + table["slip_ratio"]),
        # The slow course of adhesion alone is that of anything that rises and falls.
        course=curve(table["slip_ratio"].rolling(9, center=True, min_periods=1).mean())
        + 0.004 * draw.normal(size=len(table)),
    )
    of_run = table.groupby("run")["adhesion"]
    later = of_run.shift(1).fillna(table["adhesion"])  # a tenth of the range is its own noise
    table["motor_A"] = 1400 * (0.5 * table["adhesion"] + 0.5 * later)
    table["motor_A"] += 12 * draw.normal(size=len(table))
    found = echoes(fitted_to(table))
    assert {*found} == {"drive_Nm", "drum_mps", "motor_A"}
    assert "motor_A follows the adhesion as the slip moves it: 9" in found["motor_A"]
    assert "drive_Nm repeats the adhesion" in found["drive_Nm"]
    assert "drum_mps repeats the slip" in found["drum_mps"]


@pytest.mark.parametrize(("common", "is_left_out"), [(0.92, True), (0.88, False)])
def test_a_current_follows_the_adhesion_from_nine_tenths_of_its_variance_on(common, is_left_out):
    draw, table = np.random.default_rng(4), drawn(3)
    within = table["adhesion"] - table.groupby("run")["adhesion"].transform("mean")
    own = draw.normal(size=len(table))
    own -= pd.Series(own).groupby(table["run"].to_numpy()).transform("mean").to_numpy()
    own -= within * (own @ within) / (within @ within)  # the share is then exactly that
    own *= np.sqrt((1 / common - 1) * (within @ within) / (own @ own))
    found = echoes(fitted_to(table.assign(motor_A=1400 * (table["adhesion"] + own))))
    assert ("motor_A" in found) == is_left_out


def test_a_load_that_the_pull_moves_is_no_cause_and_one_that_was_set_may_be():
    table = drawn(3)
    force, draw = 1e5 * table["adhesion"], np.random.default_rng(5)
    moved = 1e5 - 0.2 * force + 200 * draw.normal(size=len(table))
    (why,) = echoes(fitted_to(table.assign(normal_load_N=moved))).values()
    assert "The load rises and falls with the force" in why
    of_run = 1e4 * (9 + table["run"] % 3)
    set_to = of_run * (1 - 0.01 * table["adhesion"])
    own = 1e5 + 1e4 * np.sin(0.7 * table["time_s"])
    for load in (set_to, own):
        assert echoes(fitted_to(table.assign(normal_load_N=load))) == {}


def left_of(table, spread):
    runs, law = runs_of(table), law_of(Selection(fitted_to(table, spread)), {})
    return left_by(runs, law, predicted(law, runs), 1.0, slip_noise_of(runs, None))


#: Errors that nothing rests on.
NO_ERRORS = Errors(*[Interval(0.0, 0.0, 0.0)] * 3, 1)


def course_of(table, given=None):
    """The course of a slip, where adhesion follows it and not the signal."""
    runs = runs_of(table)
    measured = as_measured(runs, given)
    plain = Selection(best_alone(problem_of(table), spread_of(measured, table), ("burckhardt",)))
    return _on_course(measured, runs, plain, ("burckhardt",))[0]


def spread_of(measured, table):
    points = problem_of(table).points
    spread = np.zeros(points.shape)
    spread[points > 0] = measured.noise.spread
    return spread


@pytest.mark.parametrize(("jumps", "least"), [(0.0005, 0.0018), (0.002, 0.006)])
def test_noise_of_adhesion_that_grows_with_the_slip_is_no_noise_of_the_slip(jumps, least):
    """Of a slip that truly jumps: weights by a noise of it would suit such errors better."""
    table = drawn(4, jumps, acts=False)
    draw, slip = np.random.default_rng(9), np.abs(table["slip_ratio"])
    error = draw.normal(size=len(table)) * least * (1 + slip / (0.3 * slip.mean()))
    course = course_of(table.assign(adhesion=curve(table["slip_ratio"]) + error))
    assert course.noise.sigma == pytest.approx(jumps, rel=0.1)
    assert course.runs is course.measured
    assert slip_noise_found(course, NO_ERRORS) == []


@pytest.mark.parametrize("acts", [True, False])
def test_noise_of_the_slip_is_told_and_smoothed_where_adhesion_does_not_follow_it(acts):
    table = drawn(4, 0.002, acts)
    course = course_of(table)
    assert course.noise.sigma == pytest.approx(0.002, rel=0.1)
    true = drawn(4)["slip_ratio"].to_numpy()
    before = np.sqrt(np.mean((course.measured.whole.slip - true) ** 2))
    after = np.sqrt(np.mean((course.runs.whole.slip - true) ** 2))
    if acts:
        assert course.p < 1e-5
        assert after < 0.5 * before
        assert np.sqrt(np.mean(course.left.spread**2)) == pytest.approx(after, rel=0.2)
        (found,) = slip_noise_found(course, NO_ERRORS)
        assert found.p_adjusted == course.p
        assert found.parameters["sigma"].value == course.noise.sigma
    else:
        assert np.isnan(course.p)
        assert after == before
        assert slip_noise_found(course, NO_ERRORS) == []
    # What is given is told as it is, and not tested.
    stays = course_of(table, 0.003)
    (stated,) = slip_noise_found(stays, NO_ERRORS)
    assert ("it is not smoothed" in stated.sentence) == (stays.runs is stays.measured)
    assert acts == (stays.runs is not stays.measured)
    assert "0.003 of slip" in stated.sentence
    assert stated.parameters["sigma"].value == 0.003
    assert np.isnan(stated.p_adjusted)


def test_the_noise_of_a_fit_is_that_of_the_campaign():
    """sigma .006, AR .6 and levels of runs that scatter by 5 %."""
    draw = np.random.default_rng(6)
    table = campaign(draw)
    scatter = (1 + 0.05 * draw.normal(size=RUNS))[table["run"]]
    error = noise(draw, sigma=0.006, correlation=0.6)
    table = table.assign(adhesion=curve(table["slip_ratio"]) * scatter + error)
    told = noise_of(left_of(table, 0.0))
    # To three standard errors: of a variance of AR .6 sqrt(2/n 2.1), of a scatter 1/sqrt(2 runs).
    rows = RUNS * POINTS
    assert told.sigma == pytest.approx(0.006, rel=3 * np.sqrt(2.1 / 2 / rows) + 0.03)
    assert told.autocorrelation == pytest.approx(0.6, abs=3 * np.sqrt(0.64 / rows) + 0.03)
    assert told.run_scatter == pytest.approx(0.05, rel=3 / np.sqrt(2 * RUNS))


@pytest.mark.parametrize(("runs", "least"), [(3, 0.25), (6, 0.031), (7, 0.016)])
def test_few_runs_say_what_they_cannot_show(runs, least):
    table = drawn(5)
    (words,) = _few_runs(problem_of(table[table["run"] < runs]))
    assert words.startswith(f"There are {runs} runs.")
    assert f"no p can be below {least:g}:" in words
    assert _few_runs(problem_of(table[table["run"] < 8])) == []
