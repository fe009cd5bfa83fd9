"""Slip, load, adhesion and wheel radius from what was measured."""

import numpy as np
import pandas as pd
import pytest

from adhesion_jax.data import to_measured
from adhesion_jax.data.derived import rolling_radius
from adhesion_jax.data.forces import Corrections
from adhesion_jax.errors import InputError

RADIUS = 0.575


def trip(seed=0, rows=6000, noise=0.0):
    """A minute and a half of traction and coasting; slip is adhesion / 40, events apart."""
    chance = np.random.default_rng(seed)
    time = 0.02 * np.arange(rows)
    speed = 12.0 + 4.0 * np.sin(time / 20)
    adhesion = 0.2 * np.clip(np.sin(time / 5), 0.0, None)
    slip = adhesion / 40
    slip[1000:1200] += 0.1  # a slip event
    rotation = speed * (1 + slip) / RADIUS + chance.normal(0, noise, rows)
    return pd.DataFrame(
        {
            "time_s": time,
            "vehicle_speed_mps": speed,
            "wheel_rotation_radps": rotation,
            "adhesion": adhesion,
        }
    )


def test_slip_comes_from_the_speeds_of_wheel_and_train():
    table = trip().assign(wheel_speed_mps=lambda one: RADIUS * one["wheel_rotation_radps"])
    slip = table["wheel_speed_mps"] / table["vehicle_speed_mps"] - 1
    by_speed = to_measured("log", table.drop(columns="wheel_rotation_radps"))
    by_radius = to_measured(
        "log", table.drop(columns="wheel_speed_mps"), known=Corrections(wheel_radius=RADIUS)
    )
    for found in (by_speed, by_radius):
        assert found.slip == "slip_ratio"
        np.testing.assert_allclose(found.table["slip_ratio"], slip, atol=1e-12)
        np.testing.assert_allclose(
            found.table["slip_velocity_mps"], slip * table["vehicle_speed_mps"], atol=1e-12
        )
        # What has served its purpose would repeat the slip under another name.
        assert not {"wheel_speed_mps", "wheel_rotation_radps"} & {*found.table}
    braking = table.assign(wheel_speed_mps=0.95 * table["vehicle_speed_mps"])
    assert to_measured("log", braking).table["slip_ratio"].max() == pytest.approx(-0.05)


def test_rows_near_standstill_are_not_used_and_counted():
    table = trip()
    table.loc[100:149, "vehicle_speed_mps"] = np.linspace(0, 0.49, 50)
    found = to_measured("log", table, known=Corrections(wheel_radius=RADIUS))
    assert len(found.table) == 5950
    assert not found.table.index.isin(range(100, 150)).any()
    assert any(
        "50 rows of 6,000 (0.833 %), in which the train is slower than 0.5 m/s" in one
        for one in found.notes
    )


def test_the_radius_is_identified_where_the_wheel_coasts():
    """Its error is that of the scatter: within three standard errors, which are of that size."""
    found = to_measured("log", trip(noise=0.02))
    (said,) = (one for one in found.notes if "rolling radius" in one)
    radius, error = float(said.split()[7]), float(said.split()[9])
    assert abs(radius - RADIUS) < 3 * error + 5e-6
    errors, misses = [], []
    for seed in range(200):
        table = trip(seed, 3000, noise=0.05)
        one = rolling_radius(
            *(table[name].to_numpy() for name in ("wheel_rotation_radps", "vehicle_speed_mps")),
            table["adhesion"].to_numpy(),
        )
        errors.append(one.standard_error)
        misses.append(one.metres - RADIUS)
    # The scatter of 200 estimates is known to 5 %; the bias is that of the mean, plus curvature.
    assert np.std(misses) == pytest.approx(np.sqrt(np.mean(np.square(errors))), rel=0.2)
    assert abs(np.mean(misses)) < 0.5 * np.std(misses)


def test_a_radius_that_cannot_be_identified_is_asked_for():
    table = trip()
    table["adhesion"] = 0.1 + table["adhesion"]
    with pytest.raises(InputError, match=r"log cannot be used: the wheel radius .*--wheel-radius"):
        to_measured("log", table)
    assert (
        "not used"
        in to_measured("log", good_with_slip(), known=Corrections(wheel_radius=0.5)).notes[-1]
    )


def test_a_slip_angle_is_the_slip_where_no_other_is_measured():
    """A tyre that is steered: lateral force over load, against the tangent of its angle."""
    slip = np.linspace(-0.12, 0.12, 80)
    table = pd.DataFrame(
        {
            "SA": -np.degrees(np.arctan(slip)),
            "FY [N]": 1000 * np.sin(1.5 * np.arctan(12 * slip)),
            "FZ [N]": -1000.0,
        }
    )
    said = {"slip_angle": "-SA [deg]", "wheel_force": "FY [N]", "wheel_load": "-FZ [N]"}
    found = to_measured("tyre", table, said)
    np.testing.assert_allclose(found.table["slip_ratio"], slip, atol=1e-12)
    assert "slip_angle_deg" not in found.table
    assert "computed: tangent of slip_angle_deg" in {*found.understood["column"]}
    # Beside a slip it stays what it is, and a wheel whose speed is measured has a slip of its own.
    both = to_measured("tyre", table.assign(slip_ratio=0.5 * slip), said)
    np.testing.assert_allclose(both.table["slip_ratio"], 0.5 * slip)
    np.testing.assert_allclose(np.tan(np.radians(both.table["slip_angle_deg"])), slip)
    with pytest.raises(InputError, match=r"slip_ratio .* is missing, wheel_speed_mps alone"):
        to_measured("tyre", table.assign(wheel_speed_mps=10.0), said)
    # What it is called is told where it is taken for a slip.
    with pytest.raises(InputError, match=r'name it slip_angle, as by --column "slip_angle=SA'):
        to_measured("tyre", table, {**said, "slip": "SA [deg]"})


def good_with_slip():
    slip = np.linspace(0.01, 0.12, 40)
    return pd.DataFrame({"slip_ratio": slip, "adhesion": 0.3 * slip / (0.02 + slip)})


@pytest.mark.parametrize(
    ("force", "load", "wheels"),
    [
        ("tangential_force_N", "normal_load_N", (1, 1)),
        ("axle_force_N", "axle_load_N", (2, 2)),
        ("locomotive_force_N", "locomotive_load_N", (8, 8)),
        ("tangential_force_N", "axle_load_N", (1, 2)),
        ("axle_force_N", "normal_load_N", (2, 1)),
    ],
)
def test_adhesion_is_force_over_load_of_the_same_wheels(force, load, wheels):
    table = good_with_slip()
    adhesion = table.pop("adhesion")
    table[force] = wheels[0] * 1e5 * adhesion
    table[load] = wheels[1] * 1e5
    found = to_measured("log", table).table
    np.testing.assert_allclose(found["adhesion"], adhesion, rtol=1e-14)
    if load != "locomotive_load_N":
        assert (found["normal_load_N"] == 1e5).all()
    assert not {"axle_force_N", "axle_load_N", "locomotive_force_N"} & {*found}


@pytest.mark.parametrize(
    ("force", "load", "factor"),
    [
        ("tangential_force_N", "locomotive_load_N", 8.0),
        ("axle_force_N", "locomotive_load_N", 4.0),
        ("locomotive_force_N", "axle_load_N", 1 / 4.0),
        ("locomotive_force_N", "normal_load_N", 1 / 8.0),
    ],
)
def test_force_and_load_of_two_bodies_go_together_by_the_driven_axles(force, load, factor):
    table = pd.DataFrame({"slip_ratio": np.linspace(0.01, 0.1, 20), force: 2e4, load: 2e5})
    with pytest.raises(InputError, match="by the number of driven axles"):
        to_measured("log", table)
    found = to_measured("log", table.assign(driven_axles=4)).table
    np.testing.assert_allclose(found["adhesion"], 0.1 * factor)
    assert "driven_axles" not in found
    wheels = {"locomotive_load_N": 8, "axle_load_N": 2, "normal_load_N": 1}[load]
    np.testing.assert_allclose(found["normal_load_N"], 2e5 / wheels)


def checked(table):
    return [note for note in to_measured("log", table).notes if note.startswith("Check")]


def test_a_speed_of_another_unit_is_told_by_distance_acceleration_and_braking():
    chance = np.random.default_rng(3)
    table = trip(noise=0.01).assign(slip_ratio=0.01).drop(columns="wheel_rotation_radps")
    speed = table["vehicle_speed_mps"]
    wrong = table.assign(vehicle_speed_mps=3.6 * speed)
    others = {
        "positions tell": {"position_m": (100 - np.cumsum(0.02 * speed)).round(1)},
        "acceleration tells": {
            "acceleration_mps2": 0.2 * np.cos(table["time_s"] / 20) + chance.normal(0, 0.1, 6000)
        },
    }
    for words, column in others.items():
        (said,) = checked(wrong.assign(**column))
        assert "as if km/h were taken for m/s" in said
        assert words in said
        assert not checked(table.assign(**column))
    # 4 m/s and 2 s: 1.6 m/s^2 at most, and 5.8 m/s^2 if it is taken for 3.6 times as much.
    hard = table.assign(vehicle_speed_mps=12 + 4 * np.sin(table["time_s"] / 2.5))
    assert not checked(hard)
    (said,) = checked(hard.assign(vehicle_speed_mps=3.6 * hard["vehicle_speed_mps"]))
    assert "no train does" in said
    # A car may, whose speed is in km/h.
    car = hard.assign(v=3.6**2 * hard["vehicle_speed_mps"]).drop(columns="vehicle_speed_mps")
    assert not checked(car.rename(columns={"v": "v [km/h]"}))


def test_a_radius_of_no_rail_wheel_is_said():
    assert not checked(trip())
    (said,) = checked(trip().assign(vehicle_speed_mps=lambda one: 3.6 * one["vehicle_speed_mps"]))
    assert "a rolling radius of 2.07 m is unusual" in said
