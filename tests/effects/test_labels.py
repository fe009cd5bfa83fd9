"""A level for each label of a column, against its formula, and what counts as labels."""

import dataclasses
import json

import jax.numpy as jnp
import numpy as np
import pytest

from adhesion_jax.curves import CURVES
from adhesion_jax.effects import Labels
from adhesion_jax.effects.conditions import Calendar
from adhesion_jax.effects.labels import MOST, NO_LABEL, labels_of
from adhesion_jax.effects.law import CorrectedLaw
from adhesion_jax.effects.saved import load_law, save_law
from adhesion_jax.effects.shape import ACTS_ON, prior_precision

RAIL = np.array([3.0, 0.0, 7.0, 3.0, 0.0, 7.0, 7.0])
LEVELS = {0.0: 0.1, 3.0: -0.2, 7.0: 0.3}


def labels(acts_on="level"):
    (start,) = Labels.starts({"rail": RAIL})
    strengths = {f"k{place}": k for place, k in enumerate(LEVELS.values(), 1)}
    return dataclasses.replace(start, **strengths, acts_on=acts_on)


def test_each_label_has_the_level_of_its_own_and_any_other_value_none():
    seen = np.array([0.0, 3.0, 7.0, -1.0, 3.5, 12.0, 1e6])
    found = labels().log_factor({"rail": jnp.asarray(seen)})
    np.testing.assert_array_equal(found, [LEVELS.get(value, 0.0) for value in seen])
    # What pads the labels that there are stands for none.
    assert float(labels().label4) == NO_LABEL


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        (RAIL, [0.0, 3.0, 7.0]),
        (np.arange(30.0) % MOST, [*range(MOST)]),
        (np.arange(30.0) % (MOST + 1), []),
        (np.array([0.0, 0.5, 1.0]), []),
        # What comes late in a long column counts as well.
        (np.append(np.arange(2000) % 3, 0.5), []),
        (np.append(np.arange(2000) % 3, 9.0), [0.0, 1.0, 2.0, 9.0]),
        (np.append(np.arange(2000) % 12, 12.0), []),
    ],
)
def test_labels_are_whole_numbers_of_which_there_are_few(values, expected):
    assert labels_of(values.astype(float)) == expected


def test_one_value_is_no_column_of_labels_and_two_are():
    assert Labels.starts({"wet": np.zeros(4)}) == []
    (two,) = Labels.starts({"wet": np.array([0.0, 1.0, 0.0, 1.0])})
    assert (two.label1, two.label2, two.k3) == (0.0, 1.0, 0.0)
    (start,) = Labels.starts({"rail": RAIL, "wear": np.linspace(0, 1, 9)})
    assert start.column == "rail"
    given = [name for name in start.FACTS.strengths if float(getattr(start, name)) != 0]
    assert given == ["k1", "k2", "k3"]


def test_every_level_has_the_prior_of_its_own():
    """Of N(0, 1.5^2) each, whatever the others are; of an offset and a shift in their own units."""
    spreads = {"level": 1.5, "slip": 1.5, "fall": 1.5, "offset": 0.3, "shift": 0.05}
    for acts_on in ACTS_ON:
        expected = np.eye(MOST) / spreads[acts_on] ** 2
        np.testing.assert_allclose(prior_precision(Labels, acts_on), expected)


@pytest.mark.parametrize("acts_on", ["level", "offset", "shift"])
def test_a_law_with_labels_is_saved_and_leaves_a_strange_label_as_it_is(tmp_path, acts_on):
    bare = CURVES["burckhardt"]
    law = CorrectedLaw(
        bare, (labels(acts_on),), {"rail": (-1.0, 7.0)}, Calendar("time_s", 0.0, 1.0)
    )
    slip = jnp.linspace(0.01, 0.2, 4)
    rail = jnp.array([3.0, -1.0, 7.0, 0.0])
    g = np.array([LEVELS[3.0], 0.0, LEVELS[7.0], LEVELS[0.0]])
    match acts_on:
        case "level":
            expected = np.asarray(bare(slip, {})) * np.exp(g)
        case "offset":
            expected = np.asarray(bare(slip, {})) + g
        case _:
            expected = np.asarray(bare(slip + g, {}))
    np.testing.assert_allclose(law(slip, {"rail": rail}), expected, rtol=1e-14)
    save_law(tmp_path / "law.json", law, {"rail": ["dry", "wet"], "operator": ["op1"]})
    loaded = load_law(tmp_path / "law.json")
    np.testing.assert_array_equal(loaded(slip, {"rail": rail}), law(slip, {"rail": rail}))
    assert json.loads((tmp_path / "law.json").read_text())["labels"] == {"rail": ["dry", "wet"]}
