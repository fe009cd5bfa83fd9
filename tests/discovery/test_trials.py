"""Which candidate is chosen, which are one class, and what is decided of each."""

from types import SimpleNamespace as Bare

import numpy as np
import pytest

from adhesion_jax.discovery.model.prediction import Gain
from adhesion_jax.discovery.search import rules, trials
from adhesion_jax.discovery.search.catalogue import Entry
from adhesion_jax.discovery.search.screening import Score
from adhesion_jax.discovery.search.trials import (
    Trial,
    choose,
    class_of,
    of_signals,
    ranked,
    shortlisted,
    tied,
)
from adhesion_jax.effects import EFFECTS, Covariate

DRAW = np.random.default_rng(8)
RUNS, POINTS = 20, 400
FIRST, SECOND = DRAW.standard_normal((2, POINTS))
BY_RUN = 2.0 + 0.3 * DRAW.standard_normal(RUNS)


def score(
    name, gain=1.0, change=FIRST, column="curvature_per_m", p=0.0005, family=None, scatter=0.05
):
    """A score that gains that share of the best in all, in each run give or take a little."""
    generic = ":" in name
    start = Covariate(0.02, 0.0, 1.0, column=column) if generic else EFFECTS["curve"](k=0.1)
    entry = Entry(name, (start,), (column,), generic, family or name)
    away = np.random.default_rng(len(name)).standard_normal(RUNS)
    gains = gain * BY_RUN + scatter * (away - away.mean())
    return Score(entry, start, 9.0, p, 3.0, gains, change)


def test_a_class_gains_as_much_and_changes_the_prediction_alike():
    best = score("best")
    alike = score("alike", 0.999, 0.8 * FIRST + 0.6 * SECOND)
    other = score("other", 0.999, 0.3 * FIRST + SECOND)
    worse = score("worse", 0.7)
    assert class_of([other, worse, alike, best], best) == ("best", "alike")


@pytest.mark.parametrize(("degrees", "is_in"), [(58.9, True), (61.1, False), (121.1, True)])
def test_members_of_a_class_share_a_quarter_of_what_they_change(degrees, is_in):
    """What two changes share is the squared cosine between them: a quarter at 60 degrees."""
    along = FIRST / np.linalg.norm(FIRST)
    across = SECOND - (SECOND @ along) * along
    across /= np.linalg.norm(across)
    angle = np.deg2rad(degrees)
    turned = score("turned", 0.999, np.cos(angle) * along + np.sin(angle) * across)
    best = score("best")
    assert class_of([best, turned], best) == (("best", "turned") if is_in else ("best",))


def test_a_class_holds_causes_and_columns_whatever_their_kind():
    """Two columns whose correlation is near one are both named, by either of them."""
    humid = score("covariate:humid", column="humid")
    warm = score("covariate:warm", 0.998, -FIRST + 0.1 * SECOND, "warm")
    cause = score("temperature", 0.997, column="warm", family="temperature")
    scores = [humid, warm, cause]
    assert class_of(scores, humid) == ("covariate:humid", "covariate:warm", "temperature")
    assert class_of(scores, warm) == ("covariate:warm", "covariate:humid", "temperature")
    # The plain form of the columns of a cause is no other name for it.
    assert class_of(scores, cause) == ("temperature", "covariate:humid")


def test_what_is_surely_behind_is_in_no_class_and_what_may_be_level_is():
    best = score("best")
    assert class_of([best, score("unsure", 0.8, scatter=1.5)], best) == ("best", "unsure")
    assert class_of([best, score("behind", 0.8)], best) == ("best",)


def test_an_error_of_a_signal_is_one_of_all_and_without_a_change_there_is_no_class():
    bias = score("slip_bias")
    assert class_of([bias], bias) == ("slip_bias", *(n for n in of_signals() if n != "slip_bias"))
    unsure = score("curve", change=np.zeros(0))
    assert class_of([unsure, score("best")], unsure) == ("curve",)


@pytest.mark.parametrize(
    ("of_cause", "error", "is_named"),
    [
        (9.0, 0.5, True),  # no more than 15 % behind
        (8.0, 0.5, False),  # four errors behind, and by more than that
        (8.0, 1.5, True),
        (5.1, 9.0, True),
        # Less than half of what the column gains, though that may be chance.
        (4.9, 9.0, False),
    ],
)
def test_a_cause_is_named_where_its_formula_fits_as_well_as_its_column(
    of_cause, error, is_named, monkeypatch
):
    monkeypatch.setattr(
        trials, "gain", lambda less, more: Gain(less.loss - more.loss, error, freedom=np.inf)
    )

    def gained(name, gain):
        return a_trial(score(name), gain)

    cause, column = gained("curve", of_cause), gained("covariate:curvature_per_m", 10.0)
    chosen = choose([column, cause], gained("nothing", 0.0))
    assert chosen is (cause if is_named else column)


def a_trial(scored, gain, effect=None):
    """A candidate refitted alone, which gains so much."""
    loss = 100.0 - gain
    return Trial(scored, Bare(loss=loss, effects=(effect or scored.start,)), loss)


@pytest.mark.parametrize(
    ("of_cause", "column", "is_named"),
    [
        (9.0, "run_time_s", False),  # surely behind a line, which is as plain
        (9.6, "run_time_s", True),  # by less than two errors
        (9.0, "curvature_per_m", True),  # a line over its own column says no more than the cause
    ],
)
def test_a_line_over_another_column_need_not_be_ahead_by_much(
    of_cause, column, is_named, monkeypatch
):
    monkeypatch.setattr(
        trials, "gain", lambda less, more: Gain(less.loss - more.loss, 0.25, freedom=np.inf)
    )
    cause = a_trial(score("curve"), of_cause)
    line = a_trial(score(f"covariate:{column}", column=column), 10.0)
    chosen = choose([line, cause], a_trial(score("nothing"), 0.0))
    assert chosen is (cause if is_named else line)


@pytest.mark.parametrize(("k", "is_named"), [(0.1, True), (0.0, True), (-0.1, False)])
def test_a_cause_of_a_sign_that_it_cannot_have_is_not_chosen_beside_a_column(
    k, is_named, monkeypatch
):
    monkeypatch.setattr(
        trials, "gain", lambda less, more: Gain(less.loss - more.loss, 0.25, freedom=np.inf)
    )
    cause = a_trial(score("curve"), 12.0, EFFECTS["curve"](k=k))
    column, nothing = a_trial(score("covariate:wear", column="wear"), 10.0), score("nothing")
    assert choose([column, cause], a_trial(nothing, 0.0)) is (cause if is_named else column)
    # Where there is no column it is the best that there is, and its name is vetoed.
    assert choose([cause], a_trial(nothing, 0.0)) is cause


def test_the_shortlist_is_of_what_gains_most_and_none_where_nothing_is_significant():
    scores = [score(f"cause {number}", 0.1 * number) for number in range(1, 12)]
    scores += [score(f"covariate:c{number}", 0.1 * number) for number in range(1, 12)]
    scores += [score("far", 9.0, p=0.5)]
    chosen = [one.entry.name for one in shortlisted(scores, 0.01)]
    causes = [f"cause {11 - place}" for place in range(rules.TRIED_CAUSES)]
    columns = [f"covariate:c{11 - place}" for place in range(rules.TRIED_COLUMNS)]
    assert chosen == [*causes, *columns]
    assert shortlisted(scores, 0.0001) == []
    assert shortlisted([], 0.01) == []


@pytest.mark.parametrize(("p", "is_in"), [(0.098, True), (0.102, False)])
def test_the_shortlist_ends_at_ten_times_the_level(p, is_in):
    chosen = shortlisted([score("first", p=0.01), score("second", p=p)], 0.01)
    assert ("second" in [one.entry.name for one in chosen]) == is_in


@pytest.mark.parametrize(("behind", "is_open"), [(1.98, True), (2.02, False)])
def test_two_units_of_support_leave_open_which_is_better(behind, is_open):
    """Edwards 1972; however sure the difference is."""
    assert tied(Gain(behind, 0.01)) == is_open


@pytest.mark.parametrize("accepted", [True, False])
def test_decisions_of_a_ranking_go_by_the_form_of_an_entry(accepted):
    names = {"best": 0.001, "alike": 0.001, "other": 0.002, "idle": 0.01, "far": 0.0102}
    scores = [score(name, p=p) for name, p in names.items()]
    # Equal copies of scores get the rows of the scores themselves.
    trials = [Trial(one._replace(), None, 1.0) for one in scores[:3]]
    given = (2, scores, trials, None)
    first = "accepted" if accepted else "does not lower the held-out error"
    rest = ["in the class of best", "explains less", "less telling", "not significant"]
    rows = ranked(*given, trials[0]._replace(), ("best", "alike"), accepted)
    assert [row.decision for row in rows] == [first, *rest]
    assert [row.round for row in rows] == [2] * 5
    # A pair that was not scored with the others has no row.
    rows = ranked(*given, None, ("best", "alike"), accepted)
    assert [row.decision for row in rows] == ["in the class of best", *rest]
