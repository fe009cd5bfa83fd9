"""Rows that would not be used do not refuse a log: left out, counted, told by their first."""

import numpy as np
import pandas as pd
import pytest

from adhesion_jax.data import check_curve, read_all, to_measured, to_runs
from adhesion_jax.data.derived import slowest
from adhesion_jax.data.forces import Corrections
from adhesion_jax.data.stretches import going_on
from adhesion_jax.errors import InputError


def log(rows=400, seed=1):
    """Ten sweeps of slip to 0.1 at 10 m/s, 20 rows a second; the adhesion is Kiencke's."""
    chance = np.random.default_rng(seed)
    slip = np.tile(np.linspace(0.0, 0.1, 40), rows // 40)
    mu = 40 * slip / (1 + 93.3 * slip + 400 * slip**2)
    return pd.DataFrame(
        {
            "time_s": 0.05 * np.arange(rows),
            "vehicle_speed_mps": 10.0,
            "wheel_speed_mps": 10.0 * (1 + slip) + chance.normal(0, 1e-3, rows),
            "tangential_force_N": 5e4 * mu,
            "normal_load_N": 5e4,
        }
    )


def after(table, rows=30, **values):
    """The same, with rows after its end in which columns have these values."""
    more = pd.concat([table.iloc[-1:]] * rows, ignore_index=True).assign(**values)
    more["time_s"] = table["time_s"].iloc[-1] + 0.05 * np.arange(1, rows + 1)
    return pd.concat([table, more], ignore_index=True)


NOISE = np.random.default_rng(0).normal(0, 0.03, 30)
WITH_SLIP = (
    log()
    .assign(slip_ratio=lambda one: one["wheel_speed_mps"] / 10 - 1)
    .drop(columns="wheel_speed_mps")
)
#: A log with rows of no use, which of them are left out, and what is said.
CASES = {
    "noise about standstill": (
        after(log(), vehicle_speed_mps=NOISE, wheel_speed_mps=-NOISE),
        range(400, 430),
        "30 rows of 430 (6.98 %), in which the train is slower than 0.5 m/s",
    ),
    "slip divided by a speed of 0": (
        after(WITH_SLIP, vehicle_speed_mps=0.0, slip_ratio=np.inf),
        range(400, 430),
        "30 values are infinite and not used: row 400 of column slip_ratio, and others",
    ),
    "a train that reverses": (
        after(log(), vehicle_speed_mps=-4.0, wheel_speed_mps=-4.0),
        range(400, 430),
        "30 rows of 430 (6.98 %), in which the train runs backwards, as its speed is negative",
    ),
    "a spin at starting": (
        after(log(), vehicle_speed_mps=0.6, wheel_speed_mps=np.linspace(1.6, 2.4, 30)),
        range(400, 430),
        "slip_ratio comes out beyond what it is in the others; the first is row 400, with 1.667",
    ),
    "a wheel that is lifted": (
        log().assign(normal_load_N=[*[5e4] * 100, 0.0, -35.0, 200.0, *[5e4] * 297]),
        range(100, 103),
        "3 values are out of range and not used: row 100 of column normal_load_N has 0 N, under",
    ),
    "one row of nonsense": (
        log().assign(vehicle_speed_mps=[*[10.0] * 77, 1e6, *[10.0] * 322]),
        range(77, 78),
        "1 value is out of range and not used: row 77 of column vehicle_speed_mps has 1e+06 m/s",
    ),
    "a tooth that is counted twice": (
        log().assign(
            wheel_speed_mps=lambda one: [
                speed * (1.5 if place in (50, 200) else 1.0)
                for place, speed in enumerate(one["wheel_speed_mps"])
            ]
        ),
        (50, 200),
        "in which the slip velocity leaps, for this row alone, further than a wheel can be "
        "accelerated; the first is row 50, with",
    ),
    "text in two rows": (
        log().assign(tangential_force_N=lambda one: [*one.iloc[:398, 3], "error", "error"]),
        range(398, 400),
        "2 values are text and not used: row 398 of column tangential_force_N has the text 'error'",
    ),
    "a clock that is set back by two rows": (
        log().assign(time_s=lambda one: one["time_s"] - np.where(one.index >= 200, 0.12, 0.0)),
        range(200, 202),
        "the clock steps back, until it shows again what it showed before; the first is row 200",
    ),
    "one time of nonsense": (
        log().assign(time_s=[*(0.05 * np.arange(200)), 1e5, *(0.05 * np.arange(201, 400))]),
        range(200, 201),
        "the clock steps back",
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_rows_of_no_use_are_left_out_counted_and_told(case):
    table, left_out, says = CASES[case]
    given = table.copy()
    found = to_measured("log", table)
    pd.testing.assert_frame_equal(table, given)  # what a caller hands over stays as it is
    assert {*range(len(table))} - {*found.table.index} == {*left_out}
    assert says in " ".join(found.notes)
    true = table["wheel_speed_mps" if "wheel_speed_mps" in table else "slip_ratio"]
    kept = true[found.table.index].to_numpy()
    slip = kept / 10 - 1 if "wheel_speed_mps" in table else kept
    np.testing.assert_allclose(found.table["slip_ratio"], slip, atol=1e-12)


@pytest.mark.parametrize(
    ("place", "leap", "is_left_out"),
    [
        # Steps of .05 s: a wheel gains at most 60 m/s^2, or 3 m/s, from row to row.
        (200, 3.1, True),
        (200, 2.9, False),
        (200, -3.1, True),
        (0, 3.1, True),  # the first and the last row have one neighbour
        (399, 3.1, True),
    ],
)
def test_a_leap_is_one_where_no_wheel_could_be_accelerated_so_fast(place, leap, is_left_out):
    table = log()
    table.loc[place - 1 : place + 1, "wheel_speed_mps"] = 10.2
    table.loc[place, "wheel_speed_mps"] += leap
    found = to_measured("log", table)
    assert {*range(400)} - {*found.table.index} == ({place} if is_left_out else set())


def test_what_leaps_less_than_twenty_usual_steps_is_noise():
    """White noise of .15 m/s at 1 kHz."""
    table = pd.concat([log()] * 5, ignore_index=True)
    table["time_s"] = 0.001 * np.arange(len(table))
    table["wheel_speed_mps"] = 10.0 + 0.15 * np.random.default_rng(0).normal(size=len(table))
    usual = np.median(np.abs(np.diff(table["wheel_speed_mps"])))
    for leap, lost in ((19.2, 0), (20.8, 1)):
        leaping = table.copy()
        leaping.loc[999:1001, "wheel_speed_mps"] = 10.0 + usual * np.array([0.0, leap, 0.0])
        assert len(table) - len(to_measured("log", leaping).table) == lost


def test_a_row_between_two_leaps_is_none():
    table = log()
    table.loc[[100, 102], "wheel_speed_mps"] *= 1.5
    assert {*range(400)} - {*to_measured("log", table).table.index} == {100, 102}


@pytest.mark.parametrize("case", CASES)
def test_a_log_that_is_nothing_else_is_refused(case):
    table, left_out, _ = CASES[case]
    some = table.loc[[*range(5), *left_out]] if len(left_out) > 2 else table.iloc[:0]
    with pytest.raises(InputError, match=r"^log cannot be used: "):
        check_curve(to_measured("log", some))


def test_a_clock_that_is_set_back_for_good_cuts_the_log():
    """Times go on behind a gap, so that the parts are runs; a second clock is its own."""
    table = log().assign(time_s=lambda one: one["time_s"] % 5.0)
    found = to_measured("log", table)
    assert len(found.table) == 400
    steps = np.diff(found.table["time_s"])
    assert (steps > 0).all()
    np.testing.assert_array_equal(np.flatnonzero(steps > 1), [99, 199, 299])
    assert "begins anew in row 100 and 2 other rows: the log is cut there" in " ".join(found.notes)


def test_runs_are_told_by_a_time_that_begins_anew(tmp_path):
    log().assign(time_s=lambda one: one["time_s"] % 5.0).to_csv(tmp_path / "a.csv", index=False)
    assert to_runs(read_all([tmp_path / "a.csv"])).lengths.tolist() == [100] * 4


@pytest.mark.parametrize("seed", range(20))
def test_time_goes_on_whatever_the_clock_does(seed):
    draw = np.random.default_rng(seed)
    series = np.sort(draw.integers(0, 3, 200)) if seed % 2 else draw.integers(0, 3, 200)
    time = np.arange(200.0)
    for place in draw.integers(0, 200, 4):
        time[place:] -= draw.integers(1, 80)
    time[draw.integers(0, 200)] = draw.normal(0, 1e6)
    moved, used, _ = going_on(time, series)
    for one in range(3):
        of_it = series == one
        assert (np.diff(moved[of_it & used]) >= 0).all()
    assert used.sum() > 100
    untouched = going_on(np.arange(200.0), series)
    assert untouched[1].all()
    assert not untouched[2].any()


@pytest.mark.parametrize("scale", [1e-6, 1e-3, 0.02, 1.0])
def test_slow_rigs_are_read_as_fast_ones_are(scale):
    """A rock sheared at um/s, a rover at mm/s, a tribometer and a train have the same slips."""
    table = log()
    for name in ("vehicle_speed_mps", "wheel_speed_mps"):
        table[name] *= scale
    found = to_measured("log", table).table
    np.testing.assert_allclose(found["slip_ratio"], log()["wheel_speed_mps"] / 10 - 1, atol=1e-9)


def test_the_slowest_speed_is_told_by_the_largest_or_by_the_noise():
    chance = np.random.default_rng(2)
    time = 0.1 * np.arange(4000)
    assert slowest(np.full(100, 30.0), None) == 0.5
    assert slowest(np.full(100, 0.01), None) == pytest.approx(5e-4)
    noisy = 0.2 + chance.normal(0, 0.01, 4000)
    assert slowest(noisy, time) == pytest.approx(0.1, rel=0.05)
    assert slowest(chance.normal(0, 0.04, 4000), time) == pytest.approx(0.4, rel=0.05)


@pytest.mark.parametrize("largest", [0.004, 0.3, 1.2, 3.2, 4.5])
def test_adhesion_from_oil_to_a_racing_tyre_is_read(largest):
    table = log().assign(tangential_force_N=lambda one: one["tangential_force_N"] * largest / 0.3)
    assert len(to_measured("log", table).table) == 400


def test_what_looks_like_another_unit_is_asked_about_until_it_is_said():
    table = log().assign(**{"Kraft [N]": lambda one: one["tangential_force_N"] / 1e3})
    table = table.drop(columns="tangential_force_N")
    said = {"wheel_force": "Kraft"}
    with pytest.raises(
        InputError, match=r"units of force and load; say .*wheel_force=Kraft \[UNIT\]"
    ):
        to_measured("log", table, said)
    units = {"wheel_force": "Kraft [N] [N]", "wheel_load": "normal_load_N [N]"}
    assert "which is unusual" in to_measured("log", table, units).notes[-1]
    right = {"wheel_force": "Kraft [N] [kN]"}
    assert to_measured("log", table, right).table["adhesion"].max() == pytest.approx(0.3, rel=0.01)


def test_a_slip_beside_two_speeds_is_compared_with_them():
    table = log().assign(slip_ratio=lambda one: one["wheel_speed_mps"] / 10 - 1)
    assert not to_measured("log", table).notes
    half = table.assign(slip_ratio=table["slip_ratio"] / 2)
    (said,) = to_measured("log", half).notes
    assert "slip_ratio: where the slip is large, it is 0.5 times wheel speed / train speed" in said


def test_slip_and_adhesion_that_are_exchanged_are_noticed():
    table = log()
    slip = table["wheel_speed_mps"] / 10 - 1
    right = pd.DataFrame({"slip_ratio": slip, "adhesion": table["tangential_force_N"] / 5e4})
    assert not to_measured("log", right).notes
    wrong = right.set_axis(["adhesion", "slip_ratio"], axis=1)
    assert any("look exchanged" in one for one in to_measured("log", wrong).notes)


@pytest.mark.parametrize("wheel", ["wheel_speed", "wheel_rotation"])
def test_speeds_of_the_wrong_sign_are_refused_with_the_sign_to_turn(wheel):
    table = log()
    if wheel == "wheel_rotation":
        table = table.assign(wheel_rotation_radps=table.pop("wheel_speed_mps") / 0.5)
    unit = {"wheel_speed": "mps", "wheel_rotation": "radps"}[wheel]
    known = Corrections(wheel_radius=0.5)
    right = to_measured("log", table, known=known).table["slip_ratio"]
    turned = table.assign(**{f"{wheel}_{unit}": -table[f"{wheel}_{unit}"]})
    with pytest.raises(InputError, match=f"other way than the train runs.*{wheel}=-COLUMN"):
        to_measured("log", turned, known=known)
    said = {wheel: f"-{wheel}_{unit}"}
    pd.testing.assert_series_equal(
        to_measured("log", turned, said, known).table["slip_ratio"], right
    )
    for one in (table, turned):
        one["vehicle_speed_mps"] *= -1
        with pytest.raises(InputError, match=r'negative \(turn its sign .*"vehicle_speed=-COLUMN"'):
            to_measured("log", one, known=known)
