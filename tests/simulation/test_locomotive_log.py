"""A simulated day of a locomotive: its physics, its noise and the files it is written to."""

import json

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from adhesion_jax.command_line.simulate import main
from adhesion_jax.errors import InputError
from adhesion_jax.simulation import locomotive_log as room
from adhesion_jax.simulation.locomotive_log import locomotive_log, tables, truth_text

HOUR = {"hours": 0.5, "events": 2}


@pytest.fixture(scope="module")
def drawn():
    return locomotive_log(seed=3, **HOUR)


@pytest.fixture(scope="module")
def table(drawn):
    return pd.concat(list(tables(drawn)), ignore_index=True)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("log")
    for name in ("log.csv", "again.csv", "log.parquet"):
        asked = ["--hours", "0.5", "--events", "2", "--seed", "3", "--out", str(folder / name)]
        result = CliRunner().invoke(main, asked, catch_exceptions=False)
        assert result.exit_code == 0
        assert "180,000 rows, 2 slip events" in result.output
    return folder


def residual(drawn, table, slip):
    """Adhesion less the curve at the true slip, from the formula of the curve."""
    c1, c2, c3 = (float(getattr(drawn.curve, name)) for name in ("c1", "c2", "c3"))
    size = np.abs(slip)
    curve = np.sign(slip) * (c1 * (1 - np.exp(-c2 * size)) - c3 * size)
    return table["tangential_force_N"] / table["normal_load_N"] - curve


def test_a_train_goes_and_stops_as_trains_do(table):
    speed = table["vehicle_speed_mps"].to_numpy()
    assert speed.min() == 0.0
    assert 15.0 < speed.max() < 32.0
    assert 0.05 < np.mean(speed == 0) < 0.4
    assert np.abs(np.diff(speed)).max() / room.STEP_S < 2.0
    np.testing.assert_allclose(table["time_s"], 0.01 * np.arange(180_000))
    assert table["relative_humidity_pct"].between(0, 100).all()


def test_the_noise_is_what_the_truth_says(drawn, table):
    stands = (table["vehicle_speed_mps"] == 0).to_numpy()
    left = residual(drawn, table, np.zeros(len(table)))[stands]
    assert left.std() == pytest.approx(0.008, rel=0.02)
    assert left.autocorr(1) == pytest.approx(0.5, abs=0.02)
    rolls = table["vehicle_speed_mps"] > 10
    # The second difference of white noise has 6 times its variance; slip changes slowly.
    wheel = (table["wheel_speed_mps"] - table["vehicle_speed_mps"])[rolls].diff().diff()
    assert wheel.std() / np.sqrt(6) == pytest.approx(0.02, rel=0.03)


def test_the_points_of_events_lie_on_the_curve(drawn, table):
    begin, length, top = drawn.events[0]
    inside = (table["time_s"] - begin) / length
    rows = table[inside.between(0.4, 0.6)]
    share = inside[rows.index]
    measured = rows["wheel_speed_mps"] / rows["vehicle_speed_mps"] - 1
    bump = top * np.sin(np.pi * share) ** 2
    micro = float(np.mean(measured - bump))
    assert 0 < micro < 0.03
    left = residual(drawn, rows, bump + micro)
    assert abs(left.mean()) < 5 * 0.008 * np.sqrt(3 / len(left))


def test_rows_do_not_depend_on_how_many_are_drawn_at_a_time(drawn, table, monkeypatch):
    monkeypatch.setattr(room, "_ROWS", 77_777)
    other = pd.concat(list(tables(drawn)), ignore_index=True)
    pd.testing.assert_frame_equal(other, table, rtol=1e-12)


def test_a_planted_effect_changes_adhesion_by_its_formula(table):
    damp = locomotive_log(seed=3, effects=("humidity",), **HOUR)
    other = pd.concat(list(tables(damp)), ignore_index=True)
    pulls = table["tangential_force_N"] > 20e3
    for name in ("wheel_speed_mps", "relative_humidity_pct"):
        np.testing.assert_array_equal(other[name], table[name])
    # exp(-0.15 (H - 65)/20) of the adhesion without noise: their mean ratio over many rows.
    factor = np.exp(-0.15 * (table["relative_humidity_pct"][pulls] - 65) / 20)
    total = table["tangential_force_N"][pulls].sum()
    expected = (factor * table["tangential_force_N"][pulls]).sum() / total
    assert other["tangential_force_N"][pulls].sum() / total == pytest.approx(expected, rel=1e-3)


def test_falling_friction_makes_adhesion_smaller_in_braking_as_in_traction():
    """By (1 + w/w0)^-a, w the size of the slip velocity."""
    sizes = np.array([0.0, 0.02, 0.1])
    speed = {"vehicle_speed_mps": np.full(3, 10.0)}
    for sign in (1, -1):
        course = room.LogCourse(sign * sizes, sizes > 1, speed)
        np.testing.assert_allclose(room.falling(0.3, course), [1, 2**-0.3, 6**-0.3], rtol=1e-12)


def test_the_peak_of_the_curve_is_not_told_as_that_of_the_rail_with_an_effect(drawn):
    damp = locomotive_log(seed=3, effects=("humidity",), **HOUR)
    plain, other = json.loads(truth_text(drawn)), json.loads(truth_text(damp))
    for name in ("mu_max", "slip_opt"):
        assert other[f"{name}_without_effects"] == plain[name]
        assert name not in other


def test_the_german_export_says_what_the_parquet_file_says(written):
    german = pd.read_csv(written / "log.csv", sep=";", decimal=",", encoding="cp1252")
    numbers = pd.read_parquet(written / "log.parquet")
    stamps = pd.to_datetime(german["Zeit"], format="%d.%m.%Y %H:%M:%S,%f")
    assert list(german) == list(numbers)
    np.testing.assert_array_equal(stamps.astype("datetime64[ms]"), numbers["Zeit"])
    for name in list(german)[1:]:
        np.testing.assert_allclose(german[name], numbers[name], atol=1e-9, rtol=0)
    assert (written / "log.csv").read_bytes() == (written / "again.csv").read_bytes()


def test_the_export_has_the_units_of_a_logger(written, table):
    numbers = pd.read_parquet(written / "log.parquet")
    np.testing.assert_allclose(numbers["v [km/h]"], 3.6 * table["vehicle_speed_mps"], atol=0.0051)
    np.testing.assert_allclose(
        numbers["Zugkraft [kN]"], table["tangential_force_N"] / 1000, atol=0.0051
    )
    assert numbers["Achslast [kN]"].between(205, 215).all()


def test_the_truth_beside_the_file(written, drawn):
    truth = json.loads((written / "log.truth.json").read_text())
    assert truth == json.loads(truth_text(drawn))
    slips = np.linspace(1e-4, 0.3, 300_000)
    c1, c2, c3 = (truth["curve"][name] for name in ("c1", "c2", "c3"))
    curve = c1 * (1 - np.exp(-c2 * slips)) - c3 * slips
    assert truth["slip_opt"] == pytest.approx(slips[curve.argmax()], abs=2e-6)
    assert truth["mu_max"] == pytest.approx(curve.max(), rel=1e-9)
    assert len(truth["events"]) == 2


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"effects": ("rust",)}, "There is no effect 'rust' of a log; name humidity or falling_"),
        ({"hours": 1e-9, "events": 0}, "A log of 1e-09 h has no row, one each 0.01 s; give more"),
        ({"hours": 0.2, "events": 99}, "not 99; give more hours or fewer events."),
    ],
)
def test_what_cannot_be_drawn_is_refused(asked, said):
    with pytest.raises(InputError, match=said):
        locomotive_log(seed=0, **asked)


def test_an_ending_that_is_not_known_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"log.xlsx is not known; name a .csv or .parquet file"):
        CliRunner().invoke(main, ["--out", str(tmp_path / "log.xlsx")], catch_exceptions=False)
    assert not list(tmp_path.iterdir())
