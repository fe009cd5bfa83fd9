"""Late signals, the inertia of the wheelset and the torque of the motor, against exact motions."""

import numpy as np
import pandas as pd
import pytest
from slip_log import INERTIA, RADAR_LATE, RADIUS, burckhardt_peak, curve, slip_events

from adhesion_jax.data import to_measured
from adhesion_jax.data.forces import Corrections
from adhesion_jax.errors import InputError

STEP = 0.05


def motion(rows=400, step=STEP):
    """Speeds that are parabolas in time, of which differences and straight lines are known."""
    time = step * np.arange(rows)
    train = 12 + 0.1 * time
    wheel = train * 1.01 + 0.002 * time**2
    return pd.DataFrame(
        {
            "time_s": time,
            "vehicle_speed_mps": train,
            "wheel_speed_mps": wheel,
            "axle_force_N": 2e4 + 100 * time,
            "axle_load_N": 2e5,
        }
    )


def read(table, **known):
    return to_measured("log", table, known=Corrections(**known))


@pytest.mark.parametrize("name", ["vehicle_speed", "vehicle_speed_mps", "speed"])
def test_a_late_signal_is_moved_to_its_time(name):
    """A straight line in time, late by 0.13 s, is itself again, up to the last 0.13 s."""
    table = motion()
    late = table.assign(vehicle_speed_mps=12 + 0.1 * (table["time_s"] - 0.13))
    found = read(late, delays={name: 0.13})
    true = to_measured("log", table).table
    assert found.table.index.tolist() == list(range(397))
    for column in ("vehicle_speed_mps", "slip_ratio", "slip_velocity_mps"):
        np.testing.assert_allclose(found.table[column], true[column][:397], rtol=0, atol=1e-12)
    assert any("3 rows of 400 (0.75 %), in which a signal" in one for one in found.notes)
    assert any("vehicle speed is moved by 0.13 s to earlier times" in one for one in found.notes)


def test_signals_that_are_late_by_the_word_for_any_column_of_them():
    table = motion()
    late = table.assign(axle_force_N=2e4 + 100 * (table["time_s"] - 0.2))
    late["wheel_speed_mps"] = np.interp(
        table["time_s"] - 0.1, table["time_s"], table["wheel_speed_mps"]
    )
    found = read(late, delays={"force": 0.2, "wheel_speed": 0.1})
    true = to_measured("log", table).table
    assert len(found.table) == 396
    np.testing.assert_allclose(found.table["adhesion"], true["adhesion"][:396], rtol=1e-12)
    np.testing.assert_allclose(
        found.table["slip_velocity_mps"], true["slip_velocity_mps"][:396], atol=1e-12
    )


def test_a_signal_that_is_early_loses_the_first_rows():
    table = motion()
    found = read(
        table.assign(vehicle_speed_mps=12 + 0.1 * (table["time_s"] + 0.1)),
        delays={"vehicle_speed": -0.1},
    )
    assert found.table.index.tolist() == list(range(2, 400))
    np.testing.assert_allclose(
        found.table["vehicle_speed_mps"], table["vehicle_speed_mps"][2:], atol=1e-12
    )


def test_nothing_is_moved_over_a_gap_or_from_run_to_run():
    first, second = motion(), motion()
    gap = pd.concat([first, second.assign(time_s=second["time_s"] + 100)], ignore_index=True)
    runs = pd.concat([first.assign(run=1), second.assign(run=2)], ignore_index=True)
    # Two axles, row by row: neighbours in the file are not neighbours in time.
    axles = pd.concat([first.assign(axle="A"), second.assign(axle="B")]).sort_index(kind="stable")
    for table in (gap, runs, axles.reset_index(drop=True)):
        late = table.assign(
            vehicle_speed_mps=table["vehicle_speed_mps"] + 5 * (np.arange(800) >= 400) - 0.02
        )
        if "axle" in table:
            late["vehicle_speed_mps"] = table["vehicle_speed_mps"] - 0.02 + 5 * (table.axle == "B")
        found = read(late, delays={"vehicle_speed": 0.2}).table
        assert len(found) == 800 - 2 * 4
        known = late["vehicle_speed_mps"] + 0.02
        np.testing.assert_allclose(
            found["vehicle_speed_mps"], known[found.index], rtol=0, atol=1e-12
        )


@pytest.mark.parametrize(
    ("columns", "delays", "says"),
    [
        (["time_s"], {"vehicle_speed": 0.2}, "cannot be taken out, because there is no time"),
        ([], {"radar": 0.2}, "radar is no signal that may be late"),
        ([], {"time": 0.2}, "time is no signal that may be late"),
        ([], {"wheel_rotation_radps": 0.2}, "there is no column of it"),
        ([], {"vehicle_speed": 20.0}, "is 20 s; give a number of seconds between -10 and 10"),
        ([], {"vehicle_speed": np.nan}, "give a number of seconds"),
    ],
)
def test_a_delay_that_cannot_be_meant_is_refused_in_one_sentence(columns, delays, says):
    with pytest.raises(InputError, match=says) as refused:
        read(motion().drop(columns=columns), delays=delays)
    assert str(refused.value).endswith(".")
    assert str(refused.value).count(". ") == 0


BODIES = {
    "axle_force_N": ("axle_load_N", 1.0, {}),
    "tangential_force_N": ("normal_load_N", 0.5, {}),
    "locomotive_force_N": ("locomotive_load_N", 4.0, {"driven_axles": 4}),
}


@pytest.mark.parametrize("force", BODIES)
@pytest.mark.parametrize("rotation", [False, True])
def test_the_inertia_of_the_wheelsets_is_taken_off_the_force(force, rotation):
    """wheelsets x J / r^2 x d(speed of the wheel)/dt, of a speed that is a parabola in time."""
    load, wheelsets, further = BODIES[force]
    table = motion().rename(columns={"axle_force_N": force, "axle_load_N": load}).assign(**further)
    slope = 0.101 + 0.004 * table["time_s"]
    wanted = (table[force] - wheelsets * INERTIA / RADIUS**2 * slope) / 2e5
    if rotation:
        table["wheel_rotation_radps"] = table.pop("wheel_speed_mps") / RADIUS
    found = read(table, wheel_radius=RADIUS, inertia=INERTIA)
    # The central difference of a parabola is exact, and at the ends there is none.
    np.testing.assert_allclose(found.table["adhesion"][5:-5], wanted[5:-5], rtol=1e-12)
    np.testing.assert_allclose(found.table["adhesion"], wanted, rtol=1e-4)
    assert any("420 kg m2 at 0.611 m, is taken off the force" in one for one in found.notes)
    assert not any("wheel radius is not used" in one for one in found.notes)


@pytest.mark.parametrize(
    ("change", "known", "says"),
    [
        (lambda one: one.drop(columns="time_s"), {"wheel_radius": RADIUS}, "a time"),
        (lambda one: one, {}, r"the radius of the wheel \(--wheel-radius in metres\)"),
        (
            lambda one: one.assign(slip_ratio=0.01).drop(columns="wheel_speed_mps"),
            {"wheel_radius": RADIUS},
            "the speed of the wheel",
        ),
        (
            lambda one: one.assign(adhesion=0.1).drop(columns="axle_force_N"),
            {"wheel_radius": RADIUS},
            "a force in the place of the adhesion",
        ),
        (
            lambda one: one.assign(time_s=10 * one["time_s"]),
            {"wheel_radius": RADIUS},
            r"the rows are 0\.5 s apart",
        ),
        (lambda one: one, {"wheel_radius": -1.0}, "The wheel radius is -1; give a number above 0"),
    ],
    ids=["time", "radius", "wheel", "force", "slow", "negative"],
)
def test_what_the_inertia_needs_is_said_in_one_sentence(change, known, says):
    with pytest.raises(InputError, match=says) as refused:
        read(change(motion()), inertia=INERTIA, **known)
    assert str(refused.value).count(". ") == 0


def test_the_torque_of_a_motor_is_a_force_at_the_rail():
    """Power in is power out: torque x rotation of the motor x efficiency = force x speed."""
    torque = np.r_[np.linspace(500, 5000, 200), np.linspace(-5000, -500, 200)]
    table = motion().drop(columns="axle_force_N").assign(motor_torque_Nm=torque)
    # Negative adhesion goes with negative slip.
    table["wheel_speed_mps"] = table["vehicle_speed_mps"] * (1 + 0.01 * np.sign(torque))
    found = read(table, wheel_radius=RADIUS, gear_ratio=4.0, efficiency=0.96).table
    motor = 4.0 * table["wheel_speed_mps"] / RADIUS
    power = torque * motor * np.where(torque > 0, 0.96, 1 / 0.96)
    np.testing.assert_allclose(found["adhesion"], power / table["wheel_speed_mps"] / 2e5)
    assert not {"motor_torque_Nm", "axle_force_N"} & {*found}
    with pytest.raises(InputError, match=r"give --gear-ratio.* and --wheel-radius"):
        read(table)
    with pytest.raises(InputError, match=r"efficiency is 1\.2; give a number above 0 and up to 1"):
        read(table, efficiency=1.2)


def test_what_is_forgotten_moves_the_peak_and_what_is_said_puts_it_back():
    """Slip events whose radar is late and whose force contains the inertia, seed by seed."""
    whole = {"wheel_radius": RADIUS, "inertia": INERTIA, "delays": {"vehicle_speed": RADAR_LATE}}
    ways = {
        "clean": {},
        "corrected": whole,
        "late": {"wheel_radius": RADIUS, "inertia": INERTIA},
        "inert": {"delays": whole["delays"]},
    }
    for seed in range(2):
        clean = slip_events(seed, late=0.0, inertia=0.0)
        peak, rms = {}, {}
        for way, known in ways.items():
            table = clean if way == "clean" else slip_events(seed)
            points = to_measured("log", table, known=Corrections(**known)).table
            slip, adhesion = (points[name].to_numpy() for name in ("slip_ratio", "adhesion"))
            peak[way] = burckhardt_peak(slip, adhesion)
            rms[way] = np.sqrt(np.mean((adhesion - curve(slip)) ** 2))
        np.testing.assert_allclose(peak["corrected"], peak["clean"], rtol=0.005)
        assert rms["corrected"] < 1.05 * rms["clean"]
        assert peak["late"][1] > 1.3 * peak["corrected"][1]
        assert peak["inert"][0] > 1.006 * peak["corrected"][0]
