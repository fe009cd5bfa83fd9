"""Signals that are late are moved to their time, and to no other."""

import numpy as np
import pandas as pd
import pytest

from adhesion_jax.data import to_measured
from adhesion_jax.data.forces import Corrections
from adhesion_jax.errors import InputError


def table(rows=200, step=0.05, late=0.0):
    """Speeds and a force that are straight lines in time, which linear interpolation keeps."""
    time = step * np.arange(rows)
    speed = 10.0 + 0.5 * (time - late)
    adhesion = 0.02 + 0.01 * time
    wheel = (10.0 + 0.5 * time) * (1 + adhesion / 10)
    return pd.DataFrame(
        {
            "time_s": time,
            "vehicle_speed_mps": speed,
            "wheel_speed_mps": wheel,
            "axle_force_N": 2e5 * adhesion,
            "axle_load_N": 2e5,
        }
    )


def read(frame, columns=None, **delays):
    return to_measured("log", frame, columns, Corrections(delays=delays))


@pytest.mark.parametrize("late", [0.2, 0.13])
def test_a_speed_that_was_late_gives_the_slip_of_one_in_time(late):
    found = read(table(late=late), vehicle_speed=late)
    in_time = to_measured("log", table()).table
    kept = np.floor((199 * 0.05 - late) / 0.05 + 1e-9).astype(int) + 1
    assert len(found.table) == kept
    np.testing.assert_allclose(found.table["slip_ratio"], in_time["slip_ratio"][:kept], atol=1e-12)
    assert f"vehicle speed is moved by {late:g} s to earlier times" in " ".join(found.notes)
    assert f"Not used are {200 - kept} rows of 200" in " ".join(found.notes)


def test_a_delay_below_zero_is_a_signal_that_is_early():
    found = read(table(late=-0.2), vehicle_speed_mps=-0.2)
    assert found.table.index[0] == 4
    np.testing.assert_allclose(
        found.table["slip_ratio"], to_measured("log", table()).table["slip_ratio"][4:], atol=1e-12
    )


def test_force_and_load_are_words_for_the_columns_that_are_there():
    late = table()
    late["axle_force_N"] = np.interp(late["time_s"] - 0.3, late["time_s"], late["axle_force_N"])
    found = read(late, force=0.3).table
    in_time = to_measured("log", table()).table
    inner = slice(7, None)
    np.testing.assert_allclose(
        found["adhesion"][inner], in_time["adhesion"][: len(found)][inner], atol=1e-12
    )
    with pytest.raises(InputError, match=r"the delay of position .* no column of it"):
        read(late, position=0.1)


@pytest.mark.parametrize("kind", ["run", "gap", "axle"])
def test_no_value_moves_over_a_gap_or_to_another_run_or_axle(kind):
    one, other = table(late=0.2), table(late=0.2)
    other[["vehicle_speed_mps", "wheel_speed_mps"]] += 5.0
    if kind == "gap":
        other["time_s"] += 100.0
    both = pd.concat([one, other], ignore_index=True)
    if kind != "gap":
        both[kind] = np.repeat(["a", "b"], 200)
    if kind == "axle":  # the axles of one moment stand one below the other
        both = both.sort_values("time_s", kind="stable", ignore_index=True)
    found = read(both, vehicle_speed=0.2).table
    assert len(found) == 2 * 196
    slower = found["vehicle_speed_mps"] - 0.5 * (found["time_s"] % 100.0)
    off = np.minimum(np.abs(slower - 10.0), np.abs(slower - 15.0))
    np.testing.assert_allclose(off, 0.0, atol=1e-9)


def test_a_slip_in_a_column_of_its_own_is_computed_anew_or_refused():
    frame = table(late=0.2)
    frame["slip_ratio"] = frame["wheel_speed_mps"] / frame["vehicle_speed_mps"] - 1
    found = read(frame, vehicle_speed=0.2)
    in_time = to_measured("log", table()).table
    np.testing.assert_allclose(found.table["slip_ratio"], in_time["slip_ratio"][:196], atol=1e-12)
    assert "slip is computed anew" in " ".join(found.notes)
    with pytest.raises(InputError, match="changes nothing, because the slip stands in a column"):
        read(frame.drop(columns="wheel_speed_mps"), vehicle_speed=0.2)
    with pytest.raises(InputError, match="changes nothing, because the adhesion stands"):
        read(frame.assign(adhesion=0.1).drop(columns="axle_load_N"), force=0.2)


def test_what_cannot_be_meant_is_refused():
    with pytest.raises(InputError, match=r"delay of vehicle_speed cannot be .* there is no time"):
        read(table().drop(columns="time_s"), vehicle_speed=0.2)
    for word in ("time_s", "time", "brake"):
        with pytest.raises(InputError, match=f"{word} is no signal that may be late"):
            read(table(), **{word: 0.2})
    for seconds in (11.0, np.nan, np.inf):
        with pytest.raises(InputError, match="The delay of force is"):
            Corrections(delays={"force": seconds})
