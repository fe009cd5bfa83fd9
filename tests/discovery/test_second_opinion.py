"""Boosted trees on a residual: silent on noise, and right about what was planted."""

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter
from sklearn.ensemble import HistGradientBoostingRegressor

import adhesion_jax as aj
from adhesion_jax.discovery.search.rules import (
    OPINION_HINTED,
    OPINION_SIGNIFICANT,
    SIGNIFICANT,
)
from adhesion_jax.discovery.search.second_opinion import second_opinion
from adhesion_jax.wording import percent
from experiments.stranger_sets import stranger

RUNS, POINTS = 28, 200
OWN = ("slip_ratio",)


def campaign(seed, runs=RUNS):
    """Nine columns, some constant within a run and some smooth in time, and the run of a point."""
    draw = np.random.default_rng([seed, 1])
    run = np.repeat(np.arange(runs), POINTS)
    time = np.tile(0.1 * np.arange(POINTS), runs)

    def smooth():
        start, slope, wave = draw.normal(size=(3, runs))[:, run]
        phase = 2 * np.pi * draw.uniform(0.5, 2.0, runs)[run] * time / 20
        return start + slope * time / 20 + wave * np.sin(phase)

    columns = {
        "slip_ratio": 0.01 * time * draw.uniform(0.6, 1.4, runs)[run],
        "time_in_run": time,
        "time_s": 300.0 * run + time,
        "vehicle_speed_mps": 20 + 5 * smooth(),
        "relative_humidity_pct": draw.uniform(20, 95, runs)[run],
        "temperature_C": draw.uniform(-5, 30, runs)[run],
        "curvature_per_m": smooth(),
        "axle": draw.integers(1, 5, runs)[run].astype(float),
        "constant": np.ones(run.size),
    }
    return columns, run


def noise(seed, correlation, scatter, runs=RUNS):
    """AR(1) of unit variance in each run, on levels that scatter from run to run."""
    draw = np.random.default_rng([seed, 2])
    white = draw.normal(size=(runs, POINTS)) * np.sqrt(1 - correlation**2)
    white[:, 0] /= np.sqrt(1 - correlation**2)
    within = lfilter([1.0], [1.0, -correlation], white, axis=1)
    return (within + scatter * draw.normal(size=(runs, 1))).ravel()


@pytest.mark.thorough
@pytest.mark.parametrize(("correlation", "scatter"), [(0.0, 0.0), (0.9, 0.0), (0.5, 1.5)])
def test_noise_is_no_opinion(correlation, scatter):
    hints = 0
    for seed in range(5):
        columns, run = campaign(seed)
        opinion = second_opinion(columns, noise(seed, correlation, scatter), run, OWN, seed)
        hints += opinion is not None
        assert opinion is None or (opinion.columns, opinion.correction) == ((), None)
    assert hints <= 2  # more of 5 by chance with p < .01


def test_what_may_be_chance_is_a_hint_without_columns_and_correction():
    columns, run = campaign(3)
    wet = columns["relative_humidity_pct"] > 60
    found = [
        second_opinion(columns, size * (wet - wet.mean()) + noise(3, 0.5, 1.0), run, OWN, 0)
        for size in (0.0, 1.5, 4.0)
    ]
    nothing, hint, sure = found
    assert nothing is None
    assert (hint.columns, hint.correction) == ((), None)
    assert OPINION_SIGNIFICANT < hint.p <= OPINION_HINTED
    assert 0 < hint.explained < sure.explained
    assert sure.p <= OPINION_SIGNIFICANT
    assert sure.columns == ("relative_humidity_pct",)


@pytest.mark.long
def test_a_level_that_follows_a_column_is_named():
    columns, run = campaign(3)
    signal = np.where(columns["relative_humidity_pct"] > 60, -3.0, 0.0)
    signal -= signal.mean()
    left = signal + noise(3, 0.5, 0.3)
    opinion = second_opinion(columns, left, run, OWN, 0)
    assert opinion.columns == ("relative_humidity_pct",)
    # The truth is the share of the signal; trees that have not seen a run know less.
    truth = np.mean(signal**2) / np.mean(left**2)
    assert 0.7 * truth < opinion.explained < truth + 2 * opinion.error
    assert 0 < opinion.error < 0.2
    assert opinion.p < 1e-4
    # In whatever unit, and every time.
    again = second_opinion(columns, 1e-4 * left, run, OWN, 0)
    assert again.columns == opinion.columns
    assert again[1:4] == pytest.approx(opinion[1:4], rel=1e-6)
    assert second_opinion(columns, left, run, OWN, 0)[:4] == opinion[:4]


@pytest.mark.long
def test_the_correction_removes_from_other_runs_the_share_that_was_told():
    columns, run = campaign(3)
    other, _ = campaign(4)
    share = np.mean(columns["relative_humidity_pct"] > 60)

    def residual(columns, seed):
        wet = columns["relative_humidity_pct"] > 60
        return 0.03 * (share - wet) + 0.01 * noise(seed, 0.5, 0.3)

    opinion = second_opinion(columns, residual(columns, 3), run, OWN, 0)
    unseen = residual(other, 4)
    left = unseen - opinion.correction(other)
    removed = 1 - np.mean(left**2) / np.mean(unseen**2)
    # The error is that of the runs that told; as many other runs scatter as much.
    assert removed == pytest.approx(opinion.explained, abs=3 * np.sqrt(2) * opinion.error)
    assert removed > 0.5


def test_what_happens_within_runs_is_seen_below_their_scatter():
    columns, run = campaign(5)
    bump = np.exp(-0.5 * ((columns["time_in_run"] - 12) / 0.8) ** 2)
    opinion = second_opinion(columns, 2 * bump + noise(5, 0.5, 2.0), run, OWN, 0)
    assert opinion.columns[:1] == ("time_in_run",)
    assert opinion.explained < 0.1  # most of it is scatter of the runs


def test_columns_of_the_slip_are_used_and_not_named():
    columns, run = campaign(7)
    columns = {name: columns[name] for name in ("slip_ratio", "temperature_C")}
    wave = np.sin(60 * columns["slip_ratio"])
    opinion = second_opinion(columns, wave + noise(7, 0.3, 0.3), run, OWN, 0)
    assert opinion.columns == ()
    assert opinion.explained > 0.2
    named = second_opinion(columns, wave + noise(7, 0.3, 0.3), run, (), 0)
    assert named.columns == ("slip_ratio",)


@pytest.mark.thorough
def test_a_column_that_trees_name_is_an_effect_where_signs_of_the_runs_do_not_tell_it():
    """A step of the level in the humidity, which hardly varies within 28 runs."""
    made = stranger(7219, 181, False)
    found = aj.discover(made.train, test=made.test, seed=181).findings
    first = [row for row in found.ranking if row.round == 0]
    assert min(row.p_adjusted for row in first) > SIGNIFICANT
    (effect,) = (*found.effects, *found.unexplained)
    assert {"relative_humidity_pct"} == {*effect.covariates}
    assert effect.by_trees
    assert effect.p_adjusted <= OPINION_SIGNIFICANT
    before, after = found.test.before.value, found.test.after.value
    assert before**2 - after**2 > 0.8 * (before**2 - made.test_noise**2)
    # Trees on top find nothing more, and what they take for something makes the law worse.
    assert found.beside_trees.before == found.test.before
    assert after < found.beside_trees.after.value < 1.2 * after
    assert not [words for words in found.warnings if words.startswith("Boosted trees on top")]


@pytest.mark.long
def test_where_trees_are_ahead_on_the_test_the_report_says_by_how_much():
    """A surface that sweeps do not show surely: neither the search nor the trees are sure of it."""
    made = stranger(20261201, 11, False)
    found = aj.discover(made.train, test=made.test, seed=11).findings
    assert found.opinion is None
    names = [*made.train.select_dtypes("number").columns.drop(["run", "adhesion"])]
    points = found.points.sort_values("slip")
    law = np.interp(made.train["slip_ratio"], *points[["slip", "after"]].to_numpy().T)
    trees = HistGradientBoostingRegressor(random_state=0)
    trees.fit(made.train[names], made.train["adhesion"] - law)
    on_top = found.predictions["corrected"] + trees.predict(made.test[names])
    error = np.sqrt(np.mean((made.test["adhesion"].to_numpy() - on_top.to_numpy()) ** 2))
    assert found.beside_trees.after.value == pytest.approx(error, rel=0.05)
    assert error < 0.97 * found.test.after.value
    (told,) = (words for words in found.foremost if words.startswith("Boosted trees on top"))
    removed = 1 - (found.beside_trees.after.value / found.test.after.value) ** 2
    assert f" remove {percent(removed)} [" in told
    assert "or this is chance" in told


@pytest.mark.long
def test_the_most_important_column_comes_first():
    columns, run = campaign(9, runs=40)
    for first, second in (("axle", "curvature_per_m"), ("curvature_per_m", "axle")):
        strong, weak = ((columns[name] - np.mean(columns[name])) for name in (first, second))
        left = 2 * strong / np.std(strong) + weak / np.std(weak) + noise(9, 0.3, 0.2, runs=40)
        assert second_opinion(columns, left, run, OWN, 0).columns == (first, second)


def test_without_enough_to_go_by_there_is_none():
    columns, run = campaign(1)
    told = columns["axle"] - np.mean(columns["axle"])
    few = run < 7
    some = {name: values[few] for name, values in columns.items()}
    assert second_opinion(some, told[few], run[few], OWN, 0) is None
    assert second_opinion({"constant": columns["constant"]}, told, run, OWN, 0) is None
    assert second_opinion(columns, np.zeros(run.size), run, OWN, 0) is None


@pytest.mark.thorough
def test_rows_of_one_run_are_judged_by_trees_where_their_order_tells_nothing():
    """Adhesion is halved where three columns are large together, a form no effect has."""
    draw = np.random.default_rng(11)
    slip = draw.uniform(0.01, 0.3, 320)
    others = {name: draw.uniform(0, 1, 320) for name in ("angle", "depth", "wear")}
    level = np.where(np.all([column > 0.3 for column in others.values()], axis=0), 0.5, 1.0)
    adhesion = 0.3 * (1 - np.exp(-40 * slip)) * level + draw.normal(0, 0.005, 320)
    rows = pd.DataFrame({"slip_ratio": slip, "adhesion": adhesion, **others})
    found = aj.discover(rows[:240], test=rows[240:], correct=True)
    assert {*found.findings.opinion.columns} <= {*others}
    missed = found.predictions[["corrected", "with_trees"]].sub(adhesion[240:], axis=0)
    assert (missed["with_trees"] ** 2).mean() < 0.9 * (missed["corrected"] ** 2).mean()

    wandering = lfilter([0.02], [1.0, -0.95], draw.normal(size=320))
    in_order = rows.assign(adhesion=0.3 * (1 - np.exp(-40 * slip)) + wandering)
    found = aj.discover(in_order[:240], test=in_order[240:], correct=True)
    assert "neighbouring errors are alike" in f"{found}".replace("\n  ", " ")
