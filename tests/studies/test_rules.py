"""The study of the rules: what is watched, what is changed, and what is counted of it."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from adhesion_jax.discovery.search import rules
from adhesion_jax.library.discover import discover
from adhesion_jax.report.discovery.words import verdict
from experiments.rules import VALUES, Watched, one_set, replaced, table
from experiments.stranger_sets import stranger


@pytest.mark.parametrize(
    ("said", "noted"),
    [
        ("rule > 0.4", set()),
        ("0.7 < rule", {0.5}),
        ("rule < 1.5", {2.0}),
        ("np.float64(1.5) >= rule", {2.0}),
        ("np.float64(0.7) <= rule * np.float64(0.9)", {0.5}),
        ("np.array([0.4, 2.0]) > rule", {2.0}),
        ("np.array([0.4, 2.0]) > rule * np.median([1.0, 3.0])", {0.5}),
        ("2 * rule < 3", {2.0}),
        ("np.arange(5.0)[:rule]", {0.5, 2.0}),
        ("1 / rule", {0.5, 2.0}),
        ("1 - rule", {0.5, 2.0}),
    ],
)
def test_a_rule_notes_the_comparisons_that_would_turn_out_otherwise(said, noted):
    seen = set()
    rule = Watched.of(1, lambda *one: seen.add(one), ("A",))
    watched, plain = (eval(said, {"np": np, "rule": one}) for one in (rule, 1))
    assert np.array_equal(watched, plain)
    assert seen == {("A", times) for times in noted}


def test_a_product_of_rules_is_watched_for_each():
    seen = set()
    first, second = (Watched.of(2.0, lambda *one: seen.add(one), (name,)) for name in "AB")
    assert first * second < 5.0
    assert seen == {("A", 2.0), ("B", 2.0)}


def failing():
    with replaced({"TRIED_FORMS": 1, "SURE_ERRORS": 9.0}):
        assert (rules.TRIED_FORMS, rules.SURE_ERRORS) == (1, 9.0)
        raise ValueError("stop")


def test_rules_are_as_they_were_after_a_study_that_failed():
    with pytest.raises(ValueError, match="stop"):
        failing()
    assert {name: getattr(rules, name) for name in VALUES} == VALUES


@pytest.mark.slow
def test_a_rule_that_decides_in_no_comparison_changes_no_report():
    task = (3, 1, False)
    decided, made = one_set(task), stranger(*task)
    plain = discover(made.train, made.test, seed=task[1]).findings
    idle = {name for name in VALUES if not decided[f"{name} x 2"]}
    assert "SIGNIFICANT" not in idle
    with replaced({name: 2 * VALUES[name] for name in idle}):
        again = discover(made.train, made.test, seed=task[1]).findings
    assert verdict(again) == verdict(plain)
    assert str(again.ranking) == str(plain.ranking)


def test_the_page_tells_what_the_table_of_the_rules_has():
    results = Path(__file__).parents[2] / "results"
    found = pd.read_csv(results / "discovery_rules.csv").set_index("rule")
    assert found["value"].to_dict() == VALUES
    idle = int((found[["halved", "doubled"]].sum(axis=1) == 0).sum())
    (sets,) = {*found["sets"]}
    page = " ".join((results.parent / "docs" / "discovery.md").read_text("utf-8").split())
    assert f"of {sets} in none by {idle} of the {len(VALUES)}" in page


def test_the_sets_in_which_a_rule_decides_are_counted():
    every = {f"{name} x {times}": [False] * 3 for name in VALUES for times in ("0.5", "2")}
    sets = pd.DataFrame(every | {"MOST_PARTS x 0.5": [True, False, True]})
    counts = table(sets).set_index("rule")
    assert counts.loc["MOST_PARTS"].to_dict() == {
        "value": rules.MOST_PARTS, "sets": 3, "halved": 2, "doubled": 0,
    }  # fmt: skip
    assert not counts.drop("MOST_PARTS")[["halved", "doubled"]].to_numpy().any()
