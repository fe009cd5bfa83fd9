"""Speeds that are held between updates, and wheels that stand for a moment, put in by hand."""

import numpy as np
import pandas as pd
import pytest

from adhesion_jax.data import to_measured
from adhesion_jax.data.speeds import between_updates, dropouts, held_for

TIME = 0.1 * np.arange(400)
SPEED = 15 + 3 * np.sin(TIME / 5)
WHEEL = SPEED * (1.02 + 0.01 * np.sin(TIME))
ONE = np.zeros(400, int)


def log(speed, wheel=WHEEL):
    adhesion = 0.2 + 0.05 * np.sin(TIME)
    names = ("time_s", "vehicle_speed_mps", "wheel_speed_mps", "adhesion")
    return pd.DataFrame(dict(zip(names, (TIME, speed, wheel, adhesion), strict=True)))


@pytest.mark.parametrize("rows", [2, 10])
def test_a_held_speed_is_put_on_straight_lines(rows):
    held = np.repeat(SPEED[::rows], rows)
    assert held_for(held, WHEEL, ONE) == rows
    found = to_measured("log", log(held))
    lines = np.interp(TIME, TIME[::rows], SPEED[::rows])[: 400 - rows + 1]
    np.testing.assert_allclose(found.table["vehicle_speed_mps"], lines, rtol=1e-12)
    np.testing.assert_allclose(
        found.table["slip_ratio"], WHEEL[: lines.size] / lines - 1, rtol=1e-9
    )
    assert any(f"changes every {rows / 10:g} s" in note for note in found.notes)


def test_a_speed_that_is_set_step_by_step_is_left_as_it_is():
    """A value for 10 s is one of a rig, and none of a slow receiver."""
    steps = log(np.repeat(SPEED[::10], 10)).assign(time_s=10 * TIME)
    table = to_measured("log", steps).table
    np.testing.assert_array_equal(table["vehicle_speed_mps"], steps["vehicle_speed_mps"])


def test_lines_do_not_go_on_over_a_gap():
    held, time = np.repeat(SPEED[::10], 10), np.where(TIME < 20, TIME, TIME + 100)
    found, known = between_updates(held, time, ONE, 10)
    assert found[190] == held[190]
    assert not known[191:200].any()
    assert known[200]
    assert found[205] == pytest.approx(0.5 * (held[205] + held[210]), rel=1e-12)


def test_a_value_that_is_told_again_holds_until_then():
    """Told in rows 3, 13, 23 and so on; the speed changes in the last of these but one."""
    held = np.where(np.arange(60) < 43, 15.0, 16.0)
    found, known = between_updates(held, TIME[:60], ONE[:60], 10)
    np.testing.assert_allclose(found[:33], 15.0, rtol=1e-12)
    np.testing.assert_allclose(found[33:44], 15 + np.arange(11) / 10, rtol=1e-12)
    np.testing.assert_allclose(found[43:54], 16.0, rtol=1e-12)
    assert np.flatnonzero(~known).tolist() == [*range(54, 60)]


@pytest.mark.parametrize(
    ("speed", "wheel"),
    [
        (SPEED, WHEEL),
        (np.round(SPEED), WHEEL),  # a speed in few digits passes them at no regular times
        (np.round(5 + 0.1 * TIME / 0.5) / 10, WHEEL),  # or at regular ones, by one digit
        (np.repeat(SPEED[::10], 10), np.repeat(WHEEL[::10], 10)),  # a log of repeated rows
        (np.full(400, 15.0), WHEEL),
    ],
)
def test_other_speeds_are_left_as_they_are(speed, wheel):
    assert held_for(speed, wheel, ONE) == 0
    np.testing.assert_array_equal(to_measured("log", log(speed, wheel)).table.iloc[:, 1], speed)


def test_a_wheel_that_stands_for_a_moment_is_no_slip():
    wheel = WHEEL.copy()
    wheel[[0, 1, *range(100, 112), 300, 398, 399]] = 0.0
    found = to_measured("log", log(SPEED, wheel))
    assert len(found.table) == 400 - 17
    assert found.table["slip_ratio"].abs().max() < 0.05
    assert any(
        "Not used are 17 rows" in note and "signal drops out" in note for note in found.notes
    )


def test_a_wheel_that_is_braked_to_a_stand_is_one():
    """In 2 s, as a wheel can be, and at once where a log has a row every second."""
    braked = WHEEL * np.clip(np.abs(TIME - 20) / 2, 0, 1)
    stands = braked == 0
    assert stands.any()
    assert not dropouts(braked - SPEED, SPEED, TIME, ONE).any()
    slow = np.where(stands, 0.0, WHEEL)
    assert not dropouts(slow - SPEED, SPEED, 10 * TIME, ONE).any()
    assert dropouts(slow - SPEED, SPEED, TIME, ONE).sum() == stands.sum()
