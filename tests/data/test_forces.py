"""Force of the motor torque, and inertia of the wheelset: against the motion of a wheelset."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from adhesion_jax.data import to_measured
from adhesion_jax.data.forces import Corrections
from adhesion_jax.errors import InputError

INERTIA, RADIUS, LOAD, RATIO = 420.0, 0.611, 2.08e5, 4.9


def event(step=0.01):
    """A slip event: slip and adhesion as functions of time, the torque from Newton's second law.

    J d(rotation)/dt = torque of the axle - radius x force in the contact; all in closed form.
    """
    time = np.arange(0.0, 20.0, step)
    speed = 15.0 + 0.5 * time
    bump = np.exp(-0.5 * ((time - 10) / 0.7) ** 2)
    slip = 0.004 + 0.09 * bump
    adhesion = 0.2 + 0.05 * bump
    rate = -0.09 * (time - 10) / 0.7**2 * bump
    acceleration = 0.5 * (1 + slip) + speed * rate  # of the circumferential speed
    force = adhesion * LOAD
    torque = RADIUS * force + INERTIA * acceleration / RADIUS
    return pd.DataFrame(
        {
            "time_s": time,
            "vehicle_speed_mps": speed,
            "wheel_speed_mps": speed * (1 + slip),
            "axle_force_N": torque / RADIUS,
            "axle_load_N": LOAD,
        }
    ), adhesion


KNOWN = Corrections(wheel_radius=RADIUS, inertia=INERTIA)


@pytest.mark.parametrize("step", [0.01, 0.05, 0.1])
def test_the_force_in_the_contact_is_that_of_the_equation_of_motion(step):
    table, adhesion = event(step)
    forgotten = to_measured("log", table).table["adhesion"] - adhesion
    found = to_measured("log", table, known=KNOWN)
    left = (found.table["adhesion"] - adhesion)[1:-1]
    assert forgotten.abs().max() > 0.008
    # The central difference over 0.15 to 0.2 s cuts off some of the largest acceleration.
    assert left.abs().max() < 0.06 * forgotten.abs().max()
    assert "inertia of the wheelset, 420 kg m2 at 0.611 m, is taken off" in " ".join(found.notes)
    assert "wheel radius is not used" not in " ".join(found.notes)


@pytest.mark.parametrize(
    ("force", "load", "share"),
    [
        ("tangential_force_N", "normal_load_N", 0.5),
        ("axle_force_N", "axle_load_N", 1.0),
        ("locomotive_force_N", "locomotive_load_N", 4.0),
    ],
)
def test_the_force_of_a_wheel_has_half_and_that_of_a_locomotive_four_wheelsets(force, load, share):
    table, adhesion = event()
    other = table.drop(columns=["axle_force_N", "axle_load_N"])
    other[force], other[load] = share * table["axle_force_N"], share * table["axle_load_N"]
    if share == 4:
        with pytest.raises(InputError, match="needs the number of driven axles"):
            to_measured("log", other, known=KNOWN)
        other["driven_axles"] = 4
    found = to_measured("log", other, known=KNOWN).table
    np.testing.assert_allclose(
        found["adhesion"], to_measured("log", table, known=KNOWN).table["adhesion"], rtol=1e-12
    )
    assert (found["adhesion"] - adhesion).abs().max() < 0.001


def test_a_rotation_tells_the_same_acceleration():
    table, _ = event()
    turned = table.assign(wheel_rotation_radps=table["wheel_speed_mps"] / RADIUS)
    np.testing.assert_allclose(
        to_measured("log", turned.drop(columns="wheel_speed_mps"), known=KNOWN).table["adhesion"],
        to_measured("log", table, known=KNOWN).table["adhesion"],
        rtol=1e-9,
    )


def test_no_acceleration_reaches_over_a_gap():
    table, _ = event()
    after = table.assign(time_s=table["time_s"] + 100, wheel_speed_mps=table["wheel_speed_mps"] + 9)
    after["vehicle_speed_mps"] += 9
    both = pd.concat([table, after, after[:2].assign(time_s=[300.0, 300.01])], ignore_index=True)
    found = to_measured("log", both, known=KNOWN)
    single = to_measured("log", table, known=KNOWN).table["adhesion"]
    np.testing.assert_allclose(found.table["adhesion"], np.tile(single, 2), rtol=1e-9)
    assert "Not used are 2 rows in stretches of time of one or two rows" in " ".join(found.notes)


@pytest.mark.parametrize(
    ("change", "known", "says"),
    [
        (lambda one: one.drop(columns="time_s"), KNOWN, r"needs a time \(time_s\)"),
        (lambda one: one, Corrections(inertia=INERTIA), "the radius of the wheel .*--wheel-radius"),
        (
            lambda one: one.drop(columns="wheel_speed_mps").assign(slip_ratio=0.01),
            KNOWN,
            "the speed of the wheel",
        ),
        (lambda one: one.assign(adhesion=0.2), KNOWN, "a force in the place of the adhesion"),
        (lambda one: one[::50], KNOWN, "the rows are 0.5 s apart"),
    ],
)
def test_what_the_inertia_lacks_is_said_in_one_sentence(change, known, says):
    with pytest.raises(InputError, match=f"log cannot be used: the inertia .*{says}") as refused:
        to_measured("log", change(event()[0]), known=known)
    assert str(refused.value).count(". ") == 0


def with_torque(sign=1.0, efficiency=1.0):
    table, adhesion = event()
    ratio = RATIO * (efficiency if sign > 0 else 1 / efficiency)
    torque = sign * adhesion * LOAD * RADIUS / ratio
    slip = sign * (table["wheel_speed_mps"] - table["vehicle_speed_mps"])
    moved = table.assign(wheel_speed_mps=table["vehicle_speed_mps"] + slip)
    named = moved.assign(**{"Motormoment [kNm]": torque / 1e3})
    return named.drop(columns="axle_force_N"), sign * adhesion


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("efficiency", [1.0, 0.95])
def test_the_torque_of_the_motor_becomes_the_force_of_the_axle(sign, efficiency):
    table, adhesion = with_torque(sign, efficiency)
    known = Corrections(wheel_radius=RADIUS, gear_ratio=RATIO, efficiency=efficiency)
    found = to_measured("log", table, known=known)
    np.testing.assert_allclose(found.table["adhesion"], adhesion, rtol=1e-12)
    assert found.covariates == ()
    assert "motor_torque_Nm" not in found.table
    assert "The force of the axle is motor torque x 4.9" in " ".join(found.notes)


def test_a_torque_with_inertia_is_that_of_the_equation_of_motion():
    table, adhesion = event()
    table["motor_torque_Nm"] = table.pop("axle_force_N") * RADIUS / RATIO
    found = to_measured("log", table, known=replace(KNOWN, gear_ratio=RATIO)).table
    assert (found["adhesion"] - adhesion)[1:-1].abs().max() < 0.001


@pytest.mark.parametrize(
    ("known", "says"),
    [
        (Corrections(), "give --gear-ratio.* and --wheel-radius in metres"),
        (Corrections(wheel_radius=RADIUS), "give --gear-ratio, the turns"),
        (Corrections(gear_ratio=RATIO), "give --wheel-radius in metres"),
    ],
)
def test_a_torque_alone_needs_gear_ratio_and_radius(known, says):
    with pytest.raises(InputError, match=f"the motor torque is the only force, .*{says}"):
        to_measured("log", with_torque()[0], known=known)


def test_a_torque_beside_a_force_is_not_used_and_explains_nothing():
    table, _ = event()
    found = to_measured("log", table.assign(**{"Drehmoment [Nm]": 1.0}))
    assert found.covariates == ()
    assert "motor_torque_Nm" not in found.table
    assert "The motor torque is not used" in " ".join(found.notes)


@pytest.mark.parametrize(
    ("given", "what"), [({"gear_ratio": RATIO}, "gear ratio"), ({"efficiency": 0.5}, "efficiency")]
)
def test_what_is_given_of_a_gear_without_a_torque_is_told_as_not_used(given, what):
    points = pd.DataFrame({"slip_ratio": np.linspace(0, 0.1, 40), "adhesion": 0.1})
    notes = to_measured("points", points, known=Corrections(**given)).notes
    assert notes == (f"The {what} is not used: no force had to be computed from a torque.",)


@pytest.mark.parametrize(
    "values", [{"inertia": 0.0}, {"gear_ratio": -1.0}, {"efficiency": 1.2}, {"wheel_radius": 0.0}]
)
def test_values_that_no_wheelset_has_are_refused(values):
    with pytest.raises(InputError, match="give a number above 0"):
        Corrections(**values)
