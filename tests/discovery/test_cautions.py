"""What is said of test data that the training data hardly cover."""

import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest
from discovery_campaigns import alone, campaign, curve, noise, problem_of, runs_of

import adhesion_jax as aj
from adhesion_jax.curves import CURVES
from adhesion_jax.data import matching
from adhesion_jax.discovery.findings.cautions import (
    absent,
    ahead_words,
    extrapolated,
    outlying,
    untested,
)
from adhesion_jax.discovery.findings.errors_by_run import errors
from adhesion_jax.discovery.findings.summary import _refuted, ranges_of
from adhesion_jax.discovery.search.state import Accepted, Selection
from adhesion_jax.discovery.types import Interval
from adhesion_jax.effects import EFFECTS, Periodic, Spline
from adhesion_jax.effects.law import CorrectedLaw


@pytest.fixture(scope="module")
def training():
    """Adhesion that falls with `warm`, which is low in nine runs of ten and high in the others."""
    draw = np.random.default_rng(4)
    table = campaign(draw)
    warm = np.where(table["run"] == 0, 1.0, 0.2 * table["warm"] / table["warm"].abs().max())
    adhesion = curve(table["slip_ratio"]) * np.exp(-0.1 * warm) + noise(draw)
    return table.assign(warm=warm, adhesion=adhesion)


@pytest.fixture(scope="module")
def said(training):
    name, columns = "covariate:warm", ("warm",)
    effect = Accepted(name, (name,), "warm", True, columns, (), p=0.001, gain=50.0)
    problem, runs = problem_of(training), runs_of(training)
    law = CorrectedLaw(CURVES["burckhardt"], (), ranges_of(problem, runs), problem.calendar)
    state = Selection(alone(training), accepted=(effect,))

    def of(table):
        return extrapolated(state, law, runs, matching(runs, runs_of(table)))

    return of


def test_test_data_like_the_training_data_are_passed_over(training, said):
    assert said(training.assign(adhesion=training["adhesion"] + 0.001)) == []
    # A few test points at the edge of what was measured are no reason.
    some = training["run"] < 3
    assert said(training.assign(warm=training["warm"].where(~some, 1.0))) == []


def test_a_column_of_the_law_whose_middles_do_not_touch_is_told(training, said):
    ((share, words),) = said(training.assign(warm=0.8 + 0.1 * (training["run"] % 2)))
    assert share == 1.0
    assert words.startswith("Nine in ten test points have warm from 0.8 to 0.9, nine in ten ")
    # Another column may be anywhere: the law does not rest on it.
    assert said(training.assign(old=training["old"] + 100)) == []


def test_a_slip_that_was_hardly_measured_is_told(training, said):
    """Test runs of rolling alone have no larger slip than those of training."""
    low = 0.005 * training["slip_ratio"]
    found = said(training.assign(slip_ratio=low, adhesion=curve(low)))
    assert [words[:35] for _, words in found] == ["Nine in ten test points have a slip"]
    # Beyond the largest of training one sentence says so, of a column as well.
    (column, slip) = (
        said(training.assign(warm=training["warm"] + 3)),
        said(training.assign(slip_ratio=training["slip_ratio"] + 0.3)),
    )
    assert [words[:5] for _, words in (*column, *slip)] == ["100 %", "100 %"]


def test_a_slip_beyond_that_of_its_own_side_is_told(training):
    """Traction to .06 and braking to .12 in training: traction to .1 is extrapolated."""
    slip = np.linspace(-0.12, 0.06, len(training))
    both = training.assign(slip_ratio=slip, adhesion=np.sign(slip) * curve(np.abs(slip)))
    problem, runs = problem_of(both), runs_of(both)
    law = CorrectedLaw(CURVES["burckhardt"], (), ranges_of(problem, runs), problem.calendar)

    def of(slip):
        adhesion = np.sign(slip) * curve(np.abs(slip))
        test = runs_of(training.assign(slip_ratio=slip, adhesion=adhesion))
        return extrapolated(Selection(alone(both)), law, runs, matching(runs, test))

    ((share, words),) = of(np.linspace(-0.11, 0.1, len(training)))
    assert share == pytest.approx(0.04 / 0.21, abs=1e-3)
    assert "(0.06 in traction, 0.12 in braking)" in words
    assert of(np.linspace(-0.11, 0.055, len(training))) == []


def test_a_side_that_was_never_measured_is_told(training, said):
    half = np.where(training["run"] % 2, -1, 1)
    sides = training.assign(
        slip_ratio=half * training["slip_ratio"], adhesion=half * training["adhesion"]
    )
    ((share, words),) = said(sides)
    assert share == pytest.approx(0.5)
    assert words.startswith("50 % of the test points are of braking, of which the training data")


def test_a_time_of_the_campaign_and_a_speed_of_the_curve_beyond_training_are_told(training):
    """Drift rests on the campaign's time, Polach's falling friction on the speed."""
    timed = training.assign(time_s=1000.0 * training["run"] + training.groupby("run").cumcount())
    timed["vehicle_speed_mps"] = 10 + timed["run"] % 3
    problem, runs = problem_of(timed), runs_of(timed)
    assert problem.calendar.column == "time_s"
    state = Selection(alone(timed, "polach-falling", (0.4, 0.4, 0.6, 150.0, 0.4)))
    later = timed.assign(time_s=timed["time_s"] + 1e5, vehicle_speed_mps=30.0)

    def told(name, table):
        effect = EFFECTS[name].starts(problem.flat)[0]
        ranges = ranges_of(problem, runs)
        law = CorrectedLaw(CURVES["polach-falling"], (effect,), ranges, problem.calendar)
        own = Accepted(name, (name,), name, False, ("time_s",), (effect,), p=0.001, gain=50.0)
        found = extrapolated(
            state._replace(accepted=(own,)), law, runs, matching(runs, runs_of(table))
        )
        return {words.split(" have ")[1].split(" outside ")[0] for _, words in found}

    assert told("drift", timed) == set()
    assert told("drift", later) == {"time_s", "vehicle_speed_mps"}
    # A lag rests on time too, but on no time of the campaign.
    assert told("lag", later) == {"vehicle_speed_mps"}


def test_a_column_of_the_law_with_a_gap_is_told_where_the_test_data_fill_it(training, said):
    warm = training["warm"]
    between = training.assign(warm=warm.where(training["run"] % 4 > 0, 0.5 + 0.05 * warm))
    ((share, words),) = said(between)
    # Training has nothing from the largest value of nineteen runs to the 1.0 of run 0.
    low = warm[training["run"] > 0].max()
    assert share == pytest.approx(0.25)
    assert words.startswith(f"25 % of the test points have warm between {low:.4g} and 1, where no ")


@pytest.mark.parametrize(
    ("left_out", "on_test", "larger"),
    [
        (0.9, 0.95, None),
        (1.02, None, "on runs left out is larger, 1.02 instead of 1"),
        # One run of twenty twice as wrong on the test data may be chance.
        (0.9, 1.01, None),
        (0.9, 1.3, "on the test data is larger, 1.3 instead of 1"),
        (1.1, 1.3, "on the test data is larger, 1.3 instead of 1"),
    ],
)
def test_a_law_is_refuted_by_runs_left_out_or_surely_by_test_data(left_out, on_test, larger):
    def errors_of(ratio):
        points = np.full(20, 100.0)
        scatter = np.linspace(0.8, 1.2, 20)[::-1] if ratio < 1.2 else np.ones(20)
        after = ratio**2 * points * scatter / scatter.mean()
        return errors(points, after, points, 0)

    accepted = [Accepted("covariate:warm", (), "warm", True, ("warm",), (), p=0.001, gain=50.0)]
    told = _refuted(accepted, errors_of(left_out), on_test and errors_of(on_test))
    assert [larger in words for words in told] == ([True] if larger else [])


@pytest.mark.thorough
def test_a_law_that_the_test_data_refute_is_told_and_not_handed_out():
    """Adhesion that rises with `warm` in the training runs, and falls with it in the others."""
    draw = np.random.default_rng(5)
    made = [campaign(draw), campaign(draw)]
    train, test = (
        table.assign(
            adhesion=curve(table["slip_ratio"]) * np.exp(sign * 0.2 * table["warm"]) + noise(draw)
        )
        for table, sign in zip(made, (1, -1), strict=True)
    )
    found = aj.discover(train, test=test)
    errors = found.findings.test
    assert [effect.covariates for effect in found.findings.unexplained] == [("warm",)]
    assert errors.removed.high < 0
    refuted = (
        "With the effects the error on the test data is larger, "
        f"{errors.after.value:.3g} instead of {errors.before.value:.3g}: the law that is saved is "
        "the curve alone."
    )
    assert refuted in found.verdict
    assert "correct" not in found.verdict.replace("the correction is of no use there", "")
    assert found.law.effects == ()
    given = found.predictions
    np.testing.assert_array_equal(given["corrected"], given["base"])
    missed = given["base"] - test["adhesion"]
    assert np.sqrt((missed**2).mean()) == pytest.approx(errors.before.value, rel=1e-12)


@pytest.mark.parametrize(
    ("error", "level", "is_far"),
    [(0.004, 0.051, True), (0.004, 0.049, False), (0.01, -0.061, True), (0.01, -0.059, False)],
)
def test_a_run_is_far_from_five_per_cent_and_from_six_times_the_scatter_on(error, level, is_far):
    after = np.append(np.zeros(19), level)  # the others scatter by their error
    levels = pd.DataFrame({"run": [*map(str, range(20))], "after": after, "error": error})
    assert bool(outlying(levels)) == is_far


@pytest.mark.parametrize(
    ("level", "words"), [(-0.502, "in run 7 by -50 %,"), (0.4, "in run 7 by 40 %,"), (0.04, "")]
)
def test_a_run_that_is_far_from_all_others_is_named(level, words):
    after = 0.012 * np.random.default_rng(2).normal(size=20)
    after[6] = level
    levels = pd.DataFrame({"run": [*map(str, range(1, 21))], "after": after, "error": 0.004})
    said = " ".join(outlying(levels))
    assert words in said
    assert (said != "") == (words != "")
    assert outlying(levels[:6]) == () == outlying(None)
    # A fifth of the runs is no outlier but another population.
    assert outlying(levels.assign(after=np.where(np.arange(20) < 4, level, after))) == ()


def test_a_column_that_is_left_out_is_not_said_to_be_absent(training):
    table = training.assign(sanding=np.where(training.index % 2, "damp", "wet"))
    runs, problem = runs_of(table), problem_of(table)
    assert "Not tested: sanding (needs the column sanding, which is left out)." in untested(
        problem, runs
    )
    assert ", sanding (left out), " in absent(runs)
    runs, problem = runs_of(training), problem_of(training)
    assert "Not tested: sanding (needs the column sanding, which is absent)." in untested(
        problem, runs
    )
    assert ", sanding, " in absent(runs)


def test_a_column_of_too_many_labels_is_said_not_to_be_tested(training):
    for count, said in ((12, []), (16, ["vehicle"])):
        table = training.assign(vehicle=[f"V{run % count:02d}" for run in training["run"]])
        told = [
            words for words in untested(problem_of(table), runs_of(table)) if ": vehicle (" in words
        ]
        assert told == [
            f"Not tested: {name} (it has 16 labels, and at most 12 of a column are tested; join "
            "those that belong together)."
            for name in said
        ]


def test_the_hour_of_a_wave_has_no_edge(training):
    """Training from 1 to 22 h, test runs from 0 to 24 h: a wave goes on past midnight."""
    hours = training.assign(tod_h=1.0 + 21 * training["run"] / training["run"].max())
    test = training.assign(tod_h=24.0 * training["run"] / training["run"].max())
    problem, runs = problem_of(hours), runs_of(hours)
    wave = Periodic(0.1, 0.2, 1 / 24, column="tod_h")
    spline = Spline.starts({"tod_h": problem.flat["tod_h"]})[0]

    def found(*effects):
        ranges = ranges_of(problem, runs)
        law = CorrectedLaw(CURVES["burckhardt"], effects, ranges, problem.calendar)
        name = "covariate:tod_h"
        own = Accepted(name, (name,), name, True, ("tod_h",), effects, p=0.001, gain=50.0)
        state = Selection(alone(hours), accepted=(own,))
        return law, extrapolated(state, law, runs, matching(runs, runs_of(test)))

    law, said = found(wave)
    assert said == []
    phase = 2 * np.pi * 23.5 / 24
    factor = 1 + 0.1 * np.sin(phase) + 0.2 * np.cos(phase)
    slip = jnp.asarray(0.03)
    bare, there = CURVES["burckhardt"](slip, {}), law(slip, {"tod_h": 23.5})
    np.testing.assert_allclose(there / bare, factor, rtol=1e-12)
    np.testing.assert_allclose(there, law(slip, {"tod_h": -0.5}), rtol=1e-12)
    # Beside a wave a spline stands, which knows nothing of midnight.
    law, ((_, words),) = found(wave, spline)
    assert words.endswith(
        "outside 1 to 22, where it was measured: there the law keeps its value " + ("at the edge.")
    )
    assert law(slip, {"tod_h": 23.5}) == law(slip, {"tod_h": 22.0})


def test_where_trees_are_ahead_a_sentence_says_by_how_much_and_how_surely():
    assert ahead_words(Interval(0.0098, 0.005, 0.02)) == []
    (sure,) = ahead_words(Interval(0.0102, 0.002, 0.02))
    assert "remove 1 % [0.2 %, 2 %] of the squared error" in sure
    assert sure.endswith("in a way that the law lacks.")
    (unsure,) = ahead_words(Interval(0.15, -0.38, 0.49))
    assert "or this is chance" in unsure
