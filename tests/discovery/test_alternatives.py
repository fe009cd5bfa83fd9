"""Which measurements are proposed to separate causes that act alike."""

import numpy as np
import pytest

from adhesion_jax.discovery.findings.alternatives import Likeness, proposals
from adhesion_jax.discovery.search.catalogue import Entry
from adhesion_jax.discovery.search.state import Accepted, Selection

STEPS = (
    "No column beside the slip and the time tells them apart: measure as many runs with steps of "
    "the slip, up and down, at different speeds."
)
SPEEDS = "vehicle_speed_mps varies over its whole range at every slip, early and late."


def proposed(own, others, members=("cleaning",), generic=False):
    """The sentences for an effect of z = 20 and rivals of cosine .8, by their columns."""
    effect = Accepted(members[0], members, "own", generic, own, (), p=0.0005, gain=200.0)
    alike = [
        Likeness(effect.name, Entry(name, (), columns, False, name), 0.8)
        for name, columns in others.items()
    ]
    found = proposals(Selection(None, (effect,)), alike)
    assert all(one.power == pytest.approx(np.sqrt(400)) for one in found)
    return {one.between[1]: one.measurement for one in found}


def test_of_a_class_it_is_not_said_that_the_data_separate_it():
    columns = ("slip_ratio", "time_s", "vehicle_speed_mps")
    others = {"lag": ("time_s",), "speed": ("vehicle_speed_mps",), "delay": ("time_s",)}
    found = proposed(columns, others, members=("cleaning", "lag"))
    apart = " These data separate the two by 12.0 standard errors."
    assert found == {
        "lag": f"Measure as many runs in which {SPEEDS}",
        "speed": f"{STEPS}{apart}",
        "delay": f"Measure as many runs in which {SPEEDS}{apart}",
    }


def test_the_slip_and_the_time_are_not_proposed_to_vary():
    rivals = {
        "friction": ("slip_ratio",),
        "warmth": ("temperature_C",),
        "both": ("relative_humidity_pct", "temperature_C", "time_s"),
        "power": ("slip_velocity_mps", "slip_ratio"),
        "wear": ("run_time_s",),
    }
    found = proposed(("slip_ratio", "time_s"), rivals)
    measured = {name: words.partition(" These data")[0] for name, words in found.items()}
    assert measured == {
        "friction": STEPS,
        "warmth": "Measure as many runs in which temperature_C varies over its whole range at "
        "every slip, early and late.",
        "both": "Measure as many runs in which relative_humidity_pct and temperature_C vary over "
        "their whole ranges at every slip, early and late.",
        "power": STEPS,
        "wear": STEPS,
    }
    (words,) = proposed(("normal_load_N", "time_s"), {"warmth": ("temperature_C",)}).values()
    assert words.startswith(
        "Measure as many runs in which normal_load_N and temperature_C vary independently of each "
        "other."
    )


def test_a_column_is_not_told_from_the_cause_of_the_same_column():
    plain = ("covariate:vehicle_speed_mps",)
    rivals = {"speed": ("vehicle_speed_mps",), "slip_speed": ("vehicle_speed_mps", "slip_ratio")}
    found = proposed(("vehicle_speed_mps",), rivals, members=plain, generic=True)
    assert [*found] == ["slip_speed"]
    assert found["slip_speed"].startswith(STEPS)
    # Two causes of one column are two causes.
    assert [*proposed(("vehicle_speed_mps",), rivals)] == ["speed", "slip_speed"]
