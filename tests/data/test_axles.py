"""Axles as columns side by side, or one below the other with a label, are one table."""

import numpy as np
import pandas as pd
import pytest

import adhesion_jax as aj
from adhesion_jax.data import read_measured, to_measured, to_runs
from adhesion_jax.data.events import events_of
from adhesion_jax.data.forces import Corrections
from adhesion_jax.errors import InputError

PEAKS = (0.3, 0.28, 0.32, 0.24)


def axle(peak, rows=300):
    """A log of one axle at 20 m/s: three sweeps of slip to 0.1."""
    slip = 0.05 * (1 - np.cos(np.linspace(0, 6 * np.pi, rows)))
    mu = peak * 40 * slip / (0.3 + 28 * slip + 120 * slip**2)
    return 72 * (1 + slip), 200 * mu


def side_by_side(rows=300):
    """A locomotive of four axles as a German logger writes it."""
    table = {"Zeit [s]": 0.1 * np.arange(rows), "v_Radar [km/h]": 72.0, "Achslast [kN]": 200.0}
    for number, peak in enumerate(PEAKS, 1):
        table[f"v_Rad{number} [km/h]"], table[f"Z_Achse{number} [kN]"] = axle(peak, rows)
    return pd.DataFrame(table)


def one_below_the_other(rows=300):
    parts = []
    for number, peak in enumerate(PEAKS, 1):
        part = side_by_side(rows).iloc[:, :3]
        part["v_Rad [km/h]"], part["Zugkraft Achse [kN]"] = axle(peak, rows)
        parts.append(part.assign(Achse=number))
    return pd.concat(parts, ignore_index=True)


@pytest.mark.parametrize("form", [side_by_side, one_below_the_other])
def test_axles_are_one_table_however_they_are_written(form, tmp_path):
    form().to_csv(tmp_path / "log.csv", index=False, sep=";", decimal=",")
    found = read_measured(tmp_path / "log.csv")
    table = found.table
    assert table["axle"].astype(str).tolist() == [one for one in "1234" for _ in range(300)]
    for number, peak in enumerate(PEAKS, 1):
        own = table[table["axle"] == str(number)]
        speed, force = axle(peak)
        np.testing.assert_allclose(own["slip_ratio"], speed / 72 - 1, atol=1e-12)
        np.testing.assert_allclose(own["adhesion"], force / 200, atol=1e-12)
        np.testing.assert_allclose(own["time_s"], 0.1 * np.arange(300), atol=1e-12)
    # Each axle is a signal in time of its own.
    assert to_runs([found]).lengths.tolist() == [300] * 4


def test_the_rows_of_axles_side_by_side_are_those_of_the_file():
    found = to_measured("log", side_by_side())
    assert found.table.index.tolist() == 4 * list(range(300))
    (said,) = [note for note in found.notes if "4 axles" in note]
    assert "used as 1,200 rows, one axle below the other" in said


def test_one_axle_is_taken_where_its_columns_are_named():
    named = {"wheel_speed": "v_Rad3", "axle_force": "Z_Achse3"}
    found = to_measured("log", side_by_side(), named)
    assert "axle" not in found.table
    np.testing.assert_allclose(found.table["adhesion"], axle(PEAKS[2])[1] / 200, atol=1e-12)


def test_one_quantity_with_an_index_is_asked_about_until_it_is_said():
    table = side_by_side().drop(columns=[f"Z_Achse{number} [kN]" for number in (2, 3, 4)])
    with pytest.raises(InputError, match=r'wheel_speed=v_Rad4 \[km/h\]" or --axles'):
        to_measured("log", table)
    found = to_measured("log", table, known=Corrections(axles=True))
    assert found.table["axle"].nunique() == 4


def test_indices_with_a_gap_are_asked_about():
    table = side_by_side().drop(columns=["v_Rad2 [km/h]", "Z_Achse2 [kN]"])
    with pytest.raises(InputError, match=r"which of the columns v_Rad1 .* is the wheel speed"):
        to_measured("log", table)


def test_each_axle_has_its_own_slip_events():
    chance = np.random.default_rng(0)
    rows, events = 6000, (40.0, 200.0, 350.0, 500.0)
    table = {"time_s": 0.1 * np.arange(rows), "v [m/s]": 15.0, "Achslast [kN]": 200.0}
    for number, begin in enumerate(events, 1):
        inside = np.clip((table["time_s"] - begin) / 6, 0, 1)
        slip = 0.002 + 0.15 * np.sin(np.pi * inside) ** 2
        table[f"v_Rad{number} [m/s]"] = 15 * (1 + slip) + chance.normal(0, 0.01, rows)
        table[f"Z_Achse{number} [kN]"] = 60 * (1 - np.exp(-80 * slip))
    found = events_of([to_measured("log", pd.DataFrame(table))])
    assert [one.points.name for one in found] == [f"log, axle {number}" for number in range(1, 5)]
    for one, begin in zip(found, events, strict=True):
        (start,) = one.events.table["start_s"]
        assert begin - 3 < start < begin + 3


@pytest.mark.long
def test_results_are_told_by_axle_beside_those_of_all():
    found = aj.identify(side_by_side(), "kiencke", events=False)
    assert [*found.groups] == ["1", "2", "3", "4"]
    for name, peak in zip("1234", PEAKS, strict=True):
        assert found.groups[name].answer.mu_max.value == pytest.approx(peak, rel=0.02)


def test_a_method_follows_one_axle():
    with pytest.raises(InputError, match="has 4 axles, and a method follows one") as refused:
        aj.track(side_by_side(), "riv")
    both = 'as by columns={"wheel_speed": "v_Rad1"} and columns={"axle_force": "Z_Achse1"}'
    assert both in str(refused.value)
    # A command, which reads the table before, tells its own options.
    with pytest.raises(InputError, match='as by --column "wheel_speed=v_Rad1" and --column "ax'):
        aj.track(to_measured("axles", side_by_side()), "riv")
