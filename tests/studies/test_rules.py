"""The study of the rules: what is watched, what is changed, and what is counted of it."""

import numpy as np
import pandas as pd
import pytest

from adhesion_jax.discovery.search import rules
from experiments.rules import TIMES, VALUES, Watched, _as_rules, _times, table


@pytest.mark.parametrize(
    ("compared", "noted"),
    [
        (lambda rule: 0.4 < rule, set()),
        (lambda rule: 0.7 < rule, {0.5}),
        (lambda rule: rule < 3.0, {2.0}),
        (lambda rule: np.float64(3.0) >= rule, {2.0}),
        (lambda rule: np.float64(0.7) > rule * np.float64(0.9), {0.5}),
        (lambda rule: np.array([0.4, 3.0]) > rule, {2.0}),
        (lambda rule: 3 > 2 * rule, {0.5, 2.0}),
        (lambda rule: range(5)[:rule], {0.5, 2.0}),
        (lambda rule: 1 / rule, {0.5, 2.0}),
    ],
)
def test_a_rule_notes_the_comparisons_that_would_turn_out_otherwise(compared, noted):
    seen = set()
    rule = Watched(1.4, lambda *one: seen.add(one), "A")
    plain = 1 if isinstance(compared(rule), range) else 1.4
    assert np.array_equal(compared(rule), compared(plain))
    assert seen == {("A", times) for times in noted}


def test_a_product_of_rules_is_watched_for_each():
    seen = set()
    first, second = (Watched(2.0, lambda *one: seen.add(one), name) for name in "AB")
    assert first * second < 5.0
    assert seen == {("A", 2.0), ("B", 2.0)}


def test_rules_are_as_they_were_after_a_study_that_failed():
    with pytest.raises(ValueError, match="stop"), _as_rules(TRIED_FORMS=1, SURE_ERRORS=9.0):
        assert rules.TRIED_FORMS == 1
        assert rules.SURE_ERRORS == 9.0
        raise ValueError("stop")
    assert {name: getattr(rules, name) for name in VALUES} == VALUES


def test_whole_numbers_stay_whole_and_above_zero():
    assert all(type(_times(name, 0.5)) is type(value) for name, value in VALUES.items())
    assert all(_times(name, times) > 0 for name in VALUES for times in TIMES)


def test_only_sets_in_which_a_rule_decides_are_counted():
    found = {"": ([1, 0, 2], [0, 0, 0], [1.0, 1.0, 1.0], ["a", "b", "c"])}
    nothing = ([None] * 3, [None] * 3, [np.nan] * 3, [None] * 3)
    found |= {f"{name} x {times:g} ": nothing for name in VALUES for times in TIMES}
    found["TRIED_FORMS x 0.5 "] = ([0, None, 2], [1, None, 0], [1.1, np.nan, 0.9], ["d", None, "c"])
    whats = ("named", "wrong", "after", "words")
    sets = pd.DataFrame(
        {
            variant + what: pd.Series(column, dtype=object if what == "words" else float)
            for variant, columns in found.items()
            for what, column in zip(whats, columns, strict=True)
        }
    )
    counts = table(sets).set_index(["rule", "times"])
    own = counts.loc[("TRIED_FORMS", 0.5)]
    assert own.drop("value").to_dict() == {
        "decides": 2, "words": 1, "named": -1, "wrong": 1, "better": 1, "worse": 1,
    }  # fmt: skip
    assert not counts.drop(columns="value").drop(("TRIED_FORMS", 0.5)).to_numpy().any()
