"""How late one speed is against the other: said where it is so, and not where it is not."""

import itertools
import re

import numpy as np
import pandas as pd
import pytest
from lanes import lanes
from late_log import trip

from adhesion_jax.data import to_measured
from adhesion_jax.data.forces import Corrections
from adhesion_jax.data.lateness import late_signals


def said(log):
    """What is said of a log: the option, the delay in s and its standard error; or nothing."""
    time, vehicle, wheel, adhesion = log
    columns = {
        "time_s": time,
        "vehicle_speed_mps": vehicle,
        "slip_velocity_mps": wheel - vehicle,
        "adhesion": adhesion,
    }
    notes = late_signals(columns, {})
    if not notes:
        return None
    (note,) = notes
    option, written = re.search(r"--delay (\w+)=(\d+\.?\d*)", note).groups()
    value, error = map(float, re.search(r"([\d.]+) ± ([\d.]+) s", note).groups())
    assert float(written) == pytest.approx(value, rel=0.05)
    return option, value, error


@pytest.mark.parametrize(
    ("seed", "late", "which"),
    lanes(
        itertools.product(range(3), [0.2, 0.1], ["vehicle", "wheel"]), always=2, thorough=8, long=2
    ),
)
def test_a_late_speed_is_told_with_its_error(seed, late, which):
    """The delay was put in by hand; the estimate is within four of its errors, and 3 ms."""
    option, value, error = said(trip(seed, seconds=900.0, **{f"{which}_late": late}))
    assert option == f"{which}_speed"
    assert abs(value - late) < 4 * error + 0.003
    assert error < 0.01


@pytest.mark.parametrize(
    ("seed", "step"), lanes(itertools.product(range(6), [0.05, 0.01]), always=2, thorough=8, long=2)
)
def test_nothing_is_said_of_signals_in_time_with_each_other(seed, step):
    assert said(trip(seed, seconds=600.0, step=step)) is None


def test_less_than_a_sample_is_never_clear():
    assert said(trip(1, seconds=900.0, step=0.25, vehicle_late=0.2)) is None


def test_a_log_of_millions_of_rows_is_sampled():
    log = trip(4, seconds=600.0, step=0.01, vehicle_late=0.3)
    hours = 40
    later = np.concatenate([log[0] + number * 1e4 for number in range(hours)])
    option, value, error = said((later, *(np.tile(one, hours) for one in log[1:])))
    assert later.size == 2_400_000
    assert option == "vehicle_speed"
    assert abs(value - 0.3) < 4 * error + 0.005


@pytest.mark.parametrize(
    "change",
    [
        lambda log: tuple(one[:100] for one in log),  # too short
        lambda log: (log[0] * 20, *log[1:]),  # a row a second
        lambda log: (log[0], np.full_like(log[1], 15.0), np.full_like(log[1], 15.1), log[3]),
        lambda log: (*log[:3], np.full_like(log[3], 0.2)),  # the force is never small
        lambda log: (*log[:3], np.zeros_like(log[3])),
    ],
    ids=["short", "slow", "steady", "pulling", "no force"],
)
def test_a_log_that_cannot_tell_says_nothing(change):
    assert said(change(trip(3, seconds=200.0))) is None


def table(log):
    names = ("time_s", "vehicle_speed_mps", "wheel_speed_mps", "adhesion")
    return pd.DataFrame(dict(zip(names, log, strict=True)))


@pytest.mark.parametrize("which", ["vehicle", "wheel"])
def test_the_option_that_is_told_takes_the_delay_out(which):
    log = table(trip(5, seconds=900.0, **{f"{which}_late": 0.2}))
    measured = to_measured("log", log)
    (note,) = (one for one in measured.notes if "late" in one)
    assert f"--delay {which}_speed=0.2" in note
    moved = to_measured("log", log, known=Corrections(delays={f"{which}_speed": 0.2}))
    assert not [one for one in moved.notes if "seems" in one]
    true = to_measured("log", table(trip(5, seconds=900.0, noise=(0.0, 0.0)))).table
    rows = slice(100, len(true) - 100)
    for found, most in ((measured, np.inf), (moved, 0.0035)):
        off = (found.table["slip_ratio"] - true["slip_ratio"]).to_numpy()[rows]
        assert np.sqrt(np.mean(off**2)) < most
    # Of 0.2 s and a deceleration of up to 0.5 m/s^2 at 15 m/s is an error of up to 0.7 %.
    late = (measured.table["slip_ratio"] - true["slip_ratio"])[true["slip_ratio"].abs() < 1e-4]
    assert np.abs(late).quantile(0.99) > 0.004


def test_a_slip_that_was_measured_is_no_difference_of_speeds():
    log = table(trip(5, seconds=900.0, vehicle_late=0.2))
    slip = log.pop("wheel_speed_mps") / log["vehicle_speed_mps"] - 1
    assert not [
        one for one in to_measured("log", log.assign(slip_ratio=slip)).notes if "late" in one
    ]
