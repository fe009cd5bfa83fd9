"""What ten runs and what twenty can show, and what they cannot."""

from collections import Counter

import numpy as np
import pytest
from discovery_campaigns import POINTS, alone, campaign, curve, levels, noise, seen, state_of
from lanes import lanes
from scipy import stats

from adhesion_jax.discovery.engine import _without_trees, opinion_of
from adhesion_jax.discovery.search import rules
from adhesion_jax.discovery.search.catalogue import Entry, column_entries, library_of
from adhesion_jax.discovery.search.probes import null_of, stretches
from adhesion_jax.discovery.search.screening import least_p, screen
from adhesion_jax.discovery.search.selection import search
from adhesion_jax.effects import Covariate, Spline

RUNS = 10


@pytest.fixture(scope="module")
def table():
    return campaign(np.random.default_rng(3), runs=RUNS)


def measured(table, draw, factor=1.0, correlation=0.8):
    made = noise(draw, runs=RUNS, correlation=correlation)
    return curve(table["slip_ratio"]) * factor * levels(draw, table, 0.02) + made


@pytest.mark.long
def test_what_moves_within_ten_runs_is_found(table):
    draw = np.random.default_rng(4)
    whole = table.assign(adhesion=measured(table, draw, np.exp(0.03 * table["gust"])))
    state = state_of(whole)
    (effect,) = search(state, library_of(state.setting.problem), 0, lambda *_: None).accepted
    assert effect.covariates == ("gust",)
    # No p is below what the signs of ten runs can show.
    assert least_p(RUNS) == 2.0**-9 <= effect.p <= rules.SIGNIFICANT


@pytest.mark.parametrize("seed", lanes([9, 10, 11], always=1, long=2))
def test_what_explains_the_levels_of_fourteen_runs_to_a_tenth_of_them_is_told(seed):
    """A column that stands still within runs, as anybody would see it in a plot of the levels."""
    draw = np.random.default_rng(seed)
    whole = campaign(draw, runs=14)
    level = np.exp(0.1 * whole["warm"]) * levels(draw, whole, 0.006)
    made = curve(whole["slip_ratio"]) * level + noise(draw, runs=14)
    fitted = alone(whole.assign(adhesion=made))
    best = screen([([null_of(fitted)], library_of(fitted.setting.problem))], 0)[0]
    assert best.entry.covariates == ("warm",)
    assert best.p <= rules.SIGNIFICANT


@pytest.mark.thorough
def test_an_effect_two_thirds_as_large_is_found_in_most_draws(table):
    named = 0
    for seed in range(4, 9):
        draw = np.random.default_rng(seed)
        whole = table.assign(adhesion=measured(table, draw, np.exp(0.02 * table["gust"])))
        state = state_of(whole)
        accepted = search(state, library_of(state.setting.problem), 0, lambda *_: None).accepted
        named += [effect.covariates for effect in accepted] == [("gust",)]
    assert named >= 4


@pytest.mark.long
def test_a_stretch_is_three_times_as_long_as_the_noise_remembers(table):
    """AR(1) of phi has (1 + phi)/(1 - phi) points: white noise 1, of .8 it is 9."""
    lengths = {}
    for correlation in (0.0, 0.8, 0.97):
        draw = np.random.default_rng(5)
        whole = table.assign(adhesion=measured(table, draw, correlation=correlation))
        firsts = stretches(null_of(alone(whole)), 3.0)
        assert {*range(0, RUNS * POINTS, POINTS)} <= {*firsts.tolist()}
        lengths[correlation] = POINTS * RUNS / firsts.size
    # 160 stretches of ten runs are sixteen a run.
    assert lengths[0.0] == 6.25
    assert 3 * 9 <= lengths[0.8] <= 2 * 3 * 9
    assert lengths[0.97] == POINTS


def test_levels_of_the_runs_are_given_within_them(table):
    draw = np.random.default_rng(6)
    null = null_of(alone(table.assign(adhesion=measured(table, draw))), within=True)
    whole = seen(null, null.fitted.adhesion[null.inside] * levels(draw, table, 0.05))
    assert np.linalg.norm(whole.residual) < 1e-8 * np.linalg.norm(null.residual)


@pytest.mark.thorough
def test_where_nothing_moves_adhesion_within_runs_p_is_as_rarely_small_as_it_says(table):
    """Of 200 draws of levels and correlated noise, but for one chance in 1000."""
    draw = np.random.default_rng(7)
    fitted = alone(table.assign(adhesion=measured(table, draw)))
    problem = fitted.setting.problem
    entries: list[Entry] = [
        entry
        for column in ("gust", "load")
        for kind in (Covariate, Spline)
        for entry in column_entries(kind, column, problem)
    ]
    nulls = [null_of(fitted, within=within) for within in (False, True)]
    found = []
    for seed in range(200):
        made = measured(table, draw)
        scores = screen([([seen(null, made) for null in nulls], entries)], seed)
        found.append(min(score.p for score in scores))
    for level in (0.01, 0.05, 0.2):
        assert np.sum(np.array(found) <= level) <= stats.binom.isf(1e-3, 200, level)


@pytest.mark.long
def test_a_smooth_function_is_as_rarely_strong_in_slow_noise_as_its_deviate_says(table):
    """Of 60 draws, but for one chance in 1000; it is tested whole, and by its smoothest two."""
    draw = np.random.default_rng(7)
    fitted = alone(table.assign(adhesion=measured(table, draw)))
    null = null_of(fitted, within=True)
    entries = [
        entry
        for column in ("gust", "load")
        for entry in column_entries(Spline, column, fitted.setting.problem)
    ]
    strong = Counter()
    for seed in range(60):
        scores = screen([([seen(null, measured(table, draw))], entries)], seed)
        assert len(scores) == len(entries)
        strong.update(score.form for score in scores if score.z > stats.norm.isf(0.01))
    assert max(strong.values()) <= stats.binom.isf(1e-3, 60, 0.02)


def best_of(fitted, columns, kind, acts_on):
    """The form of the columns of largest z."""
    problem = fitted.setting.problem
    entries = [
        entry
        for column in columns
        for entry in column_entries(kind, column, problem)
        if entry.acts_on == acts_on
    ]
    nulls = [null_of(fitted, within=within) for within in (False, True)]
    return screen([(nulls, entries)], 0)[0]


def test_a_shift_by_a_column_that_stands_still_within_runs_is_found():
    draw = np.random.default_rng(8)
    whole = campaign(draw)
    shift = 0.004 * np.sin(4 * whole["warm"])
    made = curve(whole["slip_ratio"] + shift) * levels(draw, whole, 0.01)
    fitted = alone(whole.assign(adhesion=made + noise(draw, correlation=0.3)))
    assert best_of(fitted, ("warm",), Spline, "shift").p <= rules.SIGNIFICANT


@pytest.mark.long
def test_runs_that_differ_in_more_than_their_level_make_nothing_sure():
    """Each run has a slip scale of its own that no column tells."""
    for seed in (5, 6):
        draw = np.random.default_rng(seed)
        whole = campaign(draw)
        scale = np.exp(0.2 * draw.normal(size=whole["run"].nunique()))[whole["run"]]
        made = curve(whole["slip_ratio"] * scale) + noise(draw, correlation=0.3)
        columns = ("warm", "old", "gust", "load")
        found = best_of(alone(whole.assign(adhesion=made)), columns, Spline, "slip")
        assert found.p > rules.SIGNIFICANT


def test_five_runs_are_too_few_to_ask_trees():
    draw = np.random.default_rng(7)
    few = campaign(draw, runs=5)
    adhesion = curve(few["slip_ratio"]) + noise(draw, runs=5)
    state = state_of(few.assign(adhesion=adhesion))
    assert opinion_of(state, 0) is None
    assert _without_trees(state) == (
        "8 runs would show whether they predict anything, and there are 5."
    )
