"""Slip events in logs whose events are known."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adhesion_jax.data import as_one
from adhesion_jax.data.events import HOLD_S, LEAD_S, LONG, events_of
from adhesion_jax.data.reading import to_measured
from adhesion_jax.errors import InputError
from adhesion_jax.simulation.locomotive_log import locomotive_log, tables

STEP = 0.05
#: Begin, length (s) and largest slip of events that no rule could miss.
KNOWN = ((60.0, 5.0, 0.2), (200.0, 8.0, 0.08), (333.0, 4.0, 0.12), (410.0, 6.0, 0.25))


def log(seed=0, seconds=600.0, noise=0.02, known=KNOWN, correlation=0.0, step=STEP):
    """A log of 600 s at 20 Hz and 3 to 15 m/s over a micro-slip of up to .003."""
    chance = np.random.default_rng(seed)
    time = step * np.arange(round(seconds / step))
    speed = 9 + 6 * np.sin(2 * np.pi * time / 240 + chance.uniform(0, 6))
    slip = 0.003 * np.sin(2 * np.pi * time / 90)
    for begin, length, top in known:
        inside = (time - begin) / length
        slip += np.where((inside > 0) & (inside < 1), top * np.sin(np.pi * inside) ** 2, 0.0)
    white = chance.standard_normal(time.size)
    for k in range(1, time.size if correlation else 0):
        white[k] = correlation * white[k - 1] + np.sqrt(1 - correlation**2) * white[k]
    return pd.DataFrame(
        {
            "time_s": time,
            "vehicle_speed_mps": speed,
            "slip_ratio": slip + noise * white / speed,
            "adhesion": 0.3 * np.sign(slip) * (1 - np.exp(-80 * np.abs(slip))),
        }
    )


def cut(table, wanted=None):
    (found,) = events_of([to_measured("log.csv", table)], wanted)
    return found


def test_every_event_is_found_with_its_rise_and_nothing_else():
    found = cut(log())
    table = found.events.table
    assert len(table) == len(KNOWN)
    for (_, event), (begin, length, top) in zip(table.iterrows(), KNOWN, strict=True):
        # The threshold is below .03: sin^2 of .15 of these tops is passed within .25 of a length.
        assert begin - LEAD_S - HOLD_S <= event["start_s"] <= begin + 0.25 * length - LEAD_S
        end = begin + length
        assert end - 0.25 * length + LEAD_S <= event["end_s"] <= end + LEAD_S + HOLD_S
        assert event["largest_slip"] == pytest.approx(top, rel=0.1)
        assert event["largest_adhesion"] == pytest.approx(0.3, abs=0.002)
        assert event["duration_s"] == event["end_s"] - event["start_s"]
    assert set(table["mode"]) == {"traction"}


def test_the_rows_are_those_of_the_file_between_beginning_and_end():
    table = log()
    found = cut(table)
    points = found.points.table
    for run, start, end, rows in found.events.table[["run", "start_s", "end_s", "rows"]].values:
        there = table[table["time_s"].between(start, end)]
        mine = points[points["run"] == run]
        assert len(mine) == rows
        pd.testing.assert_frame_equal(
            mine[list(table)].reset_index(drop=True), there.reset_index(drop=True)
        )
    assert found.events.share == pytest.approx(len(points) / len(table))
    assert f"{len(points):,} of {len(table):,} rows with a slip are used" in found.sentence


def test_noise_of_the_wheel_speed_is_told_from_micro_slip():
    # 0.2 s are 5 rows of 20 Hz: their average has sigma / sqrt(5).
    noise = cut(log(noise=0.05)).events.noise
    assert noise.by_speed == pytest.approx(0.05 / np.sqrt(5), rel=0.1)
    # The median of |sin| is sin(45 degrees); the noise at the usual speed adds to it.
    assert 0.003 * np.sin(np.pi / 4) * 1.4826 < noise.constant < 0.0055


@pytest.mark.parametrize("correlation", [0.0, 0.8])
@pytest.mark.parametrize("noise", [0.01, 0.05])
def test_long_logs_without_an_event_have_none(noise, correlation):
    # 20 of them, five in each case.
    for seed in range(5):
        table = log(seed, 3000.0, noise, known=(), correlation=correlation)
        with pytest.raises(InputError, match=r"log.csv has no slip event: its slip nowhere"):
            cut(table)


@pytest.mark.parametrize("noise", [0.01, 0.05])
def test_all_events_are_found_and_no_other(noise):
    complete = 0
    for seed in range(20):
        found = cut(log(100 + seed, noise=noise, correlation=0.5)).events.table
        middle = (found["start_s"] + found["end_s"]).to_numpy() / 2
        inside = [begin < place < begin + length for begin, length, _ in KNOWN for place in middle]
        assert sum(inside) == len(middle)
        complete += len(middle) == len(KNOWN)
    assert complete >= 19


@pytest.mark.long
@given(shift=st.integers(-(10**6), 10**6))
def test_another_zero_of_time_changes_nothing_else(shift):
    table = log(seconds=640.0, step=0.0625)  # a power of two, so that sums of times are exact
    there = cut(table).events.table
    moved = cut(table.assign(time_s=table["time_s"] + shift)).events.table
    pd.testing.assert_frame_equal(
        moved, there.assign(start_s=there.start_s + shift, end_s=there.end_s + shift)
    )


def test_braking_is_the_mirror_of_traction():
    table = log()
    mirror = table.assign(slip_ratio=-table["slip_ratio"], adhesion=-table["adhesion"])
    there, found = cut(table), cut(mirror)
    assert set(found.events.table["mode"]) == {"braking"}
    pd.testing.assert_frame_equal(
        found.events.table.drop(columns="mode").assign(
            largest_slip=-found.events.table["largest_slip"],
            largest_adhesion=-found.events.table["largest_adhesion"],
        ),
        there.events.table.drop(columns="mode"),
    )
    assert "(0 in traction, 4 in braking)" in found.sentence


def test_a_log_that_runs_backwards_has_the_same_events():
    table = log(seconds=640.0, step=0.0625)
    back = table[::-1].assign(time_s=640.0 - table["time_s"]).reset_index(drop=True)
    there, found = cut(table).events.table, cut(back).events.table[::-1]
    np.testing.assert_array_equal(640.0 - found["end_s"], there["start_s"])
    np.testing.assert_array_equal(640.0 - found["start_s"], there["end_s"])


def test_a_slip_velocity_gives_the_events_of_its_ratio():
    table = log()
    velocity = (table["slip_ratio"] * table["vehicle_speed_mps"]).rename("slip_velocity_mps")
    other = table.drop(columns="slip_ratio").assign(slip_velocity_mps=velocity)
    pd.testing.assert_frame_equal(
        cut(other).events.table, cut(table).events.table, check_exact=False, rtol=1e-6
    )
    alone = cut(other.drop(columns="vehicle_speed_mps"))
    assert alone.events.slip == "slip_velocity_mps"
    assert len(alone.events.table) == len(KNOWN)


def test_a_wheel_radius_that_is_slightly_wrong_moves_the_median_alone():
    table = log()
    wrong = table.assign(slip_ratio=1.02 * (1 + table["slip_ratio"]) - 1)
    found = cut(wrong)
    assert len(found.events.table) == len(KNOWN)
    assert found.events.noise.median == pytest.approx(0.02, abs=0.001)


def test_close_events_are_one_and_a_gap_makes_two_of_one():
    near = log(known=((100.0, 4.0, 0.2), (105.0, 4.0, 0.2), (300.0, 4.0, 0.2)))
    assert len(cut(near).events.table) == 2
    table = log(known=((100.0, 20.0, 0.2), (300.0, 4.0, 0.2)))
    gap = cut(table[~table["time_s"].between(109.0, 111.0)]).events.table
    assert len(gap) == 3
    assert gap["end_s"][0] < 109.0 < 111.0 < gap["start_s"][1]


def test_a_log_without_the_rows_at_rest_has_its_events():
    table = log()
    stands = table["time_s"].between(100, 130)
    speed = table["vehicle_speed_mps"].where(~stands, 0.2)
    slip = table["slip_ratio"].where(~stands, np.sin(table["time_s"]))  # worth nothing
    found = cut(table.assign(vehicle_speed_mps=speed, slip_ratio=slip))
    assert len(found.events.table) == len(KNOWN)
    assert found.events.rows == (~stands).sum()


def test_what_is_no_log_stays_as_it_is():
    table = log()
    assert len(table) >= LONG
    for other in (table[: LONG - 1], table.drop(columns="time_s"), table.assign(run=1)):
        found = cut(other)
        assert len(found.points.table) == len(other)
        assert found.events is None
        assert found.sentence == ""
    asked = cut(table[: LONG - 1], True)
    assert len(asked.events.table) == len(KNOWN)
    whole = cut(table, False)
    assert len(whole.points.table) == len(table)
    assert whole.sentence == "All 12,000 rows are used: as asked for."
    for other, why in (
        (table.drop(columns="time_s"), "no column time_s"),
        (table.assign(run=1), "a column run"),
    ):
        with pytest.raises(InputError, match=f"log.csv: it has {why}"):
            cut(other, True)


def test_a_wheel_that_slips_all_the_time_is_no_log_of_events():
    sweeps = log(known=())
    sweeps["slip_ratio"] += 0.2 * np.abs(np.sin(sweeps["time_s"] / 5))
    sweeps["adhesion"] = 0.3 * (1 - np.exp(-80 * np.abs(sweeps["slip_ratio"])))
    found = cut(sweeps)
    assert found.events is None
    assert found.sentence.startswith("All 12,000 rows are used: ")


def test_the_overview_holds_the_largest_and_smallest_values():
    table = log()
    overview = cut(table).events.overview
    assert overview["speed_high"].max() == table["vehicle_speed_mps"].max()
    assert overview["speed_low"].min() == table["vehicle_speed_mps"].min()
    assert overview["slip_high"].max() == pytest.approx(0.25, rel=0.1)
    assert (overview["slip_low"] <= overview["slip_high"]).all()
    gap = cut(table[~table["time_s"].between(250, 290)]).events.overview
    empty = (gap["start_s"] > 250) & (gap["end_s"] < 290)
    assert empty.any()
    assert gap.loc[empty, ["slip_low", "speed_high"]].isna().all(axis=None)


def test_the_events_of_a_simulated_day_are_found():
    drawn = locomotive_log(seed=5, hours=1.0, events=4)
    table = pd.concat(list(tables(drawn)), ignore_index=True)
    table["slip_ratio"] = table["wheel_speed_mps"] / table["vehicle_speed_mps"].clip(0.5) - 1
    table["slip_ratio"] = table["slip_ratio"].where(table["vehicle_speed_mps"] > 0.5, 0.0)
    found = cut(table.drop(columns="wheel_speed_mps")).events.table
    assert len(found) == 4
    assert (found["start_s"].to_numpy() < drawn.events[:, 0]).all()
    assert (found["end_s"].to_numpy() > drawn.events[:, :2].sum(axis=1)).all()


def test_a_log_without_an_event_is_not_used_where_another_has_one():
    idle = to_measured("idle.csv", log(known=()))
    slipping = to_measured("slipping.csv", log())
    (found,) = events_of([idle, slipping])
    assert found.points.name == "slipping.csv"
    assert found.sentence.endswith(" idle.csv has no slip event: not used.")
    with pytest.raises(InputError, match=r"idle.csv has no slip event: its slip nowhere"):
        events_of([idle, idle])


def test_the_unit_of_the_columns_makes_no_difference():
    table = log()
    wheel = table["vehicle_speed_mps"] * (1 + table["slip_ratio"])
    export = pd.DataFrame(
        {
            "t [ms]": 1000 * table["time_s"],
            "v [km/h]": 3.6 * table["vehicle_speed_mps"],
            "wheel speed [km/h]": 3.6 * wheel,
            "axle force [kN]": 200 * table["adhesion"],
            "axle load [kN]": 200.0,
        }
    )
    there, found = cut(table).events.table, cut(export).events.table
    pd.testing.assert_frame_equal(found, there, check_exact=False, rtol=1e-6)


def test_the_events_of_several_files_are_runs_of_their_own():
    parts = [to_measured(f"{name}.csv", log(seed)) for seed, name in enumerate("ab")]
    logs = events_of(parts)
    whole = as_one([one.points for one in logs])
    assert whole.name == "a.csv, b.csv"
    runs = whole.table["run"].unique()
    assert list(runs) == [f"{name}.csv:{event}" for name in "ab" for event in range(1, 5)]
    assert len(whole.table) == sum(len(one.points.table) for one in logs)
    second = whole.table[whole.table["run"] == "b.csv:2"]
    times = logs[1].events.table.loc[1, ["start_s", "end_s"]]
    assert list(second["time_s"].iloc[[0, -1]]) == list(times)
    assert as_one(parts[:1]) is parts[0]


@pytest.mark.parametrize(("noises", "events"), [(5.9, 0), (6.1, 1)])
def test_an_event_exceeds_six_times_the_scatter_of_the_averaged_slip(noises, events):
    table = log(known=(), noise=0.0)
    slip = 0.005 * np.sin(table["time_s"].to_numpy())
    averaged = np.convolve(slip, np.ones(5) / 5, "same")  # over .2 s
    scatter = 1.4826 * np.median(np.abs(averaged - np.median(averaged)))
    slip[6000:6020] = np.median(averaged) + noises * scatter
    table = table.assign(slip_ratio=slip, vehicle_speed_mps=9.0)
    if events:
        assert len(cut(table, True).events.table) == 1
    else:
        with pytest.raises(InputError):
            cut(table, True)
