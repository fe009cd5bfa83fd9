"""What columns are taken as: units, names, what the user says, and how files are written."""

import io
from datetime import datetime, time

import numpy as np
import pandas as pd
import pyarrow
import pytest

from adhesion_jax.data import check_curve, read_all, read_measured, to_measured
from adhesion_jax.data.cells import decimal_mark, form_of, numbers, seconds, stamps, unwrapped
from adhesion_jax.data.columns import COLUMNS, Guess, conversion, guess, named
from adhesion_jax.errors import InputError


def good(rows=40):
    slip = np.linspace(0.01, 0.12, rows)
    return pd.DataFrame({"slip_ratio": slip, "adhesion": 0.3 * slip / (0.02 + slip)})


@pytest.mark.parametrize(
    ("unit", "wanted", "factor", "offset"),
    [
        ("km/h", "m/s", 1 / 3.6, 0),
        ("kmh", "m/s", 1 / 3.6, 0),
        ("mph", "m/s", 0.44704, 0),
        ("kN", "N", 1e3, 0),
        ("t", "N", 9806.65, 0),  # the weight of a tonne at standard gravity, CGPM 1901
        ("lbf", "N", 4.4482216152605, 0),
        ("%", "1", 0.01, 0),
        ("‰", "1", 0.001, 0),
        ("1", "%", 100, 0),
        ("K", "degree C", 1, -273.15),
        ("°F", "degree C", 5 / 9, -160 / 9),
        ("U/min", "rad/s", 2 * np.pi / 60, 0),
        ("rpm", "rad/s", 2 * np.pi / 60, 0),
        ("rad", "degree", 180 / np.pi, 0),
        ("ms", "s", 1e-3, 0),
        ("m/s²", "m/s^2", 1, 0),
        ("g", "m/s^2", 9.80665, 0),
        ("1/km", "1/m", 1e-3, 0),
    ],
)
def test_units_are_those_of_the_tables(unit, wanted, factor, offset):
    found = conversion(unit, wanted)
    assert found.factor == pytest.approx(factor, rel=1e-12)
    assert found.offset == pytest.approx(offset, rel=1e-12)


@pytest.mark.parametrize(
    ("unit", "wanted"),
    [
        ("kN", "m/s"),
        ("F", "N"),  # a farad
        ("°", "1"),  # to pint an angle is a number
        ("%", "degree"),
        ("°C", "N"),  # whose zero is not that of a force
        ("1/s", "rad/s"),  # a turn or a radian
        ("furlong/x", "m/s"),
        ("", "1"),
        ("3", "1"),
    ],
)
def test_what_is_no_unit_of_a_quantity_converts_to_nothing(unit, wanted):
    assert conversion(unit, wanted) is None


def test_a_name_may_hold_the_word_for_its_unit():
    assert guess("wheel rpm") == Guess("wheel_rotation_radps", "rpm")
    assert guess("axle rpm").quantity == "wheel_rotation_radps"
    assert guess("tractive effort per axle [kN]") == Guess("axle_force_N", "kN")


def test_every_quantity_has_a_unit_that_is_known():
    for name, column in COLUMNS.items():
        assert conversion(column.unit, column.unit).factor == 1, name
        assert guess(name).quantity == name


@pytest.mark.parametrize(
    ("name", "stem", "unit"),
    [
        ("v_kmh", "v", "kmh"),
        ("v [km/h]", "v", "km/h"),
        ("rH (%)", "rH", "%"),
        ("T/°C", "T", "°C"),
        ("v/km/h", "v", "km/h"),
        ("speed km/h", "speed", "km/h"),
        ("Schlupf in %", "Schlupf", "%"),
        ("T (Luft) [°C]", "T (Luft)", "°C"),
        ("Schlupf [-]", "Schlupf", "-"),
        ("rail_age_days", "rail_age_days", ""),
        ("F/Q", "F/Q", ""),
        ("note", "note", ""),
    ],
)
def test_a_name_is_parted_from_its_unit(name, stem, unit):
    assert named(name) == (stem, unit)


@pytest.mark.parametrize(
    ("name", "quantity"),
    [
        ("v_kmh", "vehicle_speed_mps"),
        ("Geschwindigkeit [km/h]", "vehicle_speed_mps"),
        ("v_Rad [km/h]", "wheel_speed_mps"),
        ("wheel speed m/s", "wheel_speed_mps"),
        ("Raddrehzahl [U/min]", "wheel_rotation_radps"),
        ("Schlupf in %", "slip_ratio"),
        ("slip_pct", "slip_ratio"),
        ("Radlast [kN]", "normal_load_N"),
        ("Achslast (t)", "axle_load_N"),
        ("rH (%)", "relative_humidity_pct"),
        ("T/°C", "temperature_C"),
        ("t [s]", "time_s"),
        ("Zeit_ms", "time_s"),
        ("mu", "adhesion"),
        ("Fahrt", "run"),
        # Nothing is guessed where two meanings fit, or the unit is not said.
        ("T", ""),
        ("v", ""),
        ("slip", ""),
        ("Zugkraft [kN]", ""),
        ("F [kN]", ""),
        ("load", ""),
        ("n [rpm]", ""),
        ("humidity", ""),
        ("v [kN]", ""),
        ("rail_age_days", ""),
    ],
)
def test_a_name_is_a_quantity_where_one_meaning_fits(name, quantity):
    assert guess(name).quantity == quantity


def test_the_row_of_units_goes_before_the_unit_of_the_name():
    assert guess("v", "km/h") == ("vehicle_speed_mps", "km/h", "", (), -1)
    assert guess("slip_ratio", "%").unit == "%"


@pytest.mark.parametrize(
    ("cells", "mark", "values"),
    [
        (["1,5", "-0,25", "1e3"], ",", [1.5, -0.25, 1000]),
        (["1.234,5", "2,5"], ",", [1234.5, 2.5]),
        (["1,234.5", "2.5"], ".", [1234.5, 2.5]),
        ([" 1.5", "2.5 ", ""], ".", [1.5, 2.5, np.nan]),
        (["7", "-", "NaN"], None, [7, np.nan, np.nan]),
    ],
)
def test_numbers_are_read_by_their_decimal_mark(cells, mark, values):
    assert decimal_mark(cells) == mark
    found, text = numbers(pyarrow.array(cells), mark or ".")
    assert not text.size
    np.testing.assert_array_equal(found, values)


@pytest.mark.parametrize(
    ("cells", "mark"), [(["1.5", "2,5"], "."), (["1,5", "2.5"], ","), (["1,5", "0.300"], ",")]
)
def test_the_other_mark_is_text_where_it_parts_no_thousands(cells, mark):
    found, text = numbers(pyarrow.array(cells), mark)
    assert text.tolist() == [1]
    np.testing.assert_array_equal(found, [1.5, np.nan])


@pytest.mark.parametrize("cells", [["1,234", "5,678"], ["3", "4"], ["24.11.2026"]])
def test_what_could_be_either_shows_no_mark(cells):
    assert decimal_mark(cells) is None


@pytest.mark.parametrize(
    "written",
    [
        "2026-11-24 08:00:00.010",
        "2026-11-24T08:00:00,010",
        "24.11.2026 08:00:00,010",
        "24.11.26 8:00:00.010",
        "24/11/2026 08:00:00.01",
        "2026-11-24T09:00:00.010+01:00",
        "2026-11-24 08:00:00.010Z",
        "2026/11/24 08:00:00.010",
        "24-Nov-2026 08:00:00.010",
        "24 nov 2026 8:00:00,010",
        "24.11.2026 8:00:00.010 AM",
        "2026-11-24 08:00:00.010 a.m.",
    ],
)
def test_a_stamp_is_the_same_however_it_is_written(written):
    assert form_of([written, ""])
    later = written.replace("24", "25", 1)
    ticks, _ = stamps(pyarrow.array([written, "", later]))
    known = datetime(2026, 11, 24, 8).timestamp() - datetime(1970, 1, 1).timestamp()
    origin = int(known) * 10**9
    np.testing.assert_array_equal(seconds(ticks, origin), [0.01, np.nan, 86400.01])


def test_what_is_no_stamp_is_told_by_its_place():
    assert form_of(["13/04/2026 08:00:00", "03/13/2026 08:00:00"]) == ""
    assert form_of(["7", "8"]) == form_of(["", ""]) == ""
    assert stamps(pyarrow.array(["08:00:00", "", "soon"]))[1].tolist() == [2]


@pytest.mark.parametrize(
    ("written", "form"),
    [
        (["03/04/2026 08:00", "13/04/2026 08:00"], "day/month/year and time"),
        (["03/04/2026 08:00", "03/13/2026 08:00"], "month/day/year and time"),
        (["03/04/2026 08:00"], "day/month/year or month/day/year and time"),
        (["03/04/2026"], "day/month/year or month/day/year"),
        (["3.4.2026", ""], "day.month.year"),
        (["2026-04-03"], "a date"),
        (["8:00:00"], "a time of day"),
        (["12:00:00 am", "1:00 PM"], "a time of day"),
        (["13:00:00 PM"], ""),
        (["00:10.0", "59:59,9"], "a time within the hour"),
        (["3-Apr-2026 8:00"], "day-month-year and time"),
        (["-", "8:00:00", "NaN"], "a time of day"),
        (["3.4.2026 8:00Z", "3.4.2026 8:00+02:00"], "day.month.year with zone and time"),
        (["24.11.2026 23:59:59", "25.11.2026"], "day.month.year and time"),
    ],
)
def test_stamps_have_a_form(written, form):
    assert form_of(written) == form


@pytest.mark.parametrize("day", ["2026-11-25", "25.11.2026", "25.11.26", "2026/11/25"])
def test_midnight_may_be_written_as_the_date_alone(day):
    """As spreadsheets show it; a stamp that is missing is none of the form."""
    written = [f"{day.replace('25', '24')} 23:59:59", "-", day, f"{day} 00:00:01"]
    ticks, strange = stamps(pyarrow.array(written), form_of(written))
    assert strange.size == 0
    since = pd.Timestamp("2026-11-25").value
    np.testing.assert_array_equal(seconds(ticks, since), [-1, np.nan, 0, 1])


def test_the_two_halves_of_a_day():
    written = ["11/24/2026 12:00:05 AM", "11/24/2026 1:00 am", "", "11/24/2026 12:30:00.5 PM"]
    ticks, strange = stamps(pyarrow.array([*written, "11/24/2026 11:59:59 p.m."]), form_of(written))
    assert strange.size == 0
    since = pd.Timestamp("2026-11-24").value
    np.testing.assert_array_equal(seconds(ticks, since), [5, 3600, np.nan, 45000.5, 86399])


def test_a_time_within_the_hour_goes_on_past_it(tmp_path):
    written = [
        f"{(59 * 60 + 50 + row) % 3600 // 60:02d}:{(50 + row) % 60:02d}.5" for row in range(40)
    ]
    assert form_of(written) == "a time within the hour"
    good().assign(Time=written).to_csv(tmp_path / "a.csv", index=False)
    found = read_measured(tmp_path / "a.csv").table["time_s"]
    np.testing.assert_array_equal(np.diff(found), 1)


def test_times_of_no_form_that_is_read_are_told(tmp_path):
    table = good().assign(Time=[f"2026-W48-2T08:00:{row:02d}" for row in range(40)])
    table.to_csv(tmp_path / "a.csv", index=False)
    notes = " ".join(read_measured(tmp_path / "a.csv").notes)
    assert "column Time is not used as a time: its cells have no form of dates or times" in notes
    assert "unit" not in notes


def test_the_origin_of_stamps_with_a_zone_is_in_utc(tmp_path):
    stamps = [f"2026-11-24 08:00:{row:02d}+01:00" for row in range(40)]
    table = good().assign(Time=stamps, sanding=[row % 2 == 1 for row in range(40)])
    table.to_csv(tmp_path / "a.csv", index=False)
    frame = table.assign(Time=pd.to_datetime(table["Time"]))
    for found in (read_measured(tmp_path / "a.csv"), to_measured("log", frame)):
        assert "The time counts from 2026-11-24 07:00:00 UTC." in found.notes
        # As a data frame has them, and as it writes them.
        np.testing.assert_array_equal(found.table["sanding"], np.arange(40) % 2)


def test_a_label_none_is_a_label_and_a_number_none_is_missing(tmp_path):
    """Empty cells and what spreadsheets write for an error are no labels."""
    names = ["none", "NA", "-", "oil", "", "NaN", "#N/A", "#NV"]
    table = good().assign(rail=np.resize(names, 40), v=["none", *map(str, range(39))])
    table.to_csv(tmp_path / "a.csv", index=False)
    found = read_measured(tmp_path / "a.csv", {"group": "rail"}).table
    assert [*found["group"]] == (5 * names[:4])[1:]  # the first row has no number


def stamped(first, day):
    """A table with its dates in one column and the times of day in another."""
    table = good()
    at = pd.Timestamp(first) + pd.to_timedelta(0.5 * np.arange(len(table)), unit="s")
    table.insert(0, "Datum", at.strftime(day))
    table.insert(1, "Zeit", at.strftime("%H:%M:%S.%f"))
    return table


@pytest.mark.parametrize("day", ["%d.%m.%Y", "%Y-%m-%d", "%d/%m/%Y", "%m/%d/%Y"])
def test_a_date_and_a_time_in_two_columns_are_one_stamp(day, tmp_path):
    table = stamped("2026-11-24 23:59:50", day)
    table.to_csv(tmp_path / "a.csv", index=False, sep=";")
    found = read_measured(tmp_path / "a.csv")
    np.testing.assert_allclose(found.table["time_s"], 0.5 * np.arange(40))
    assert "The time counts from 2026-11-24 23:59:50." in found.notes
    assert found.understood["column"][0] == "Datum Zeit"
    assert not {"Datum", "Zeit"} & {*found.left_out}


def test_dates_and_times_of_a_data_frame_are_one_stamp():
    at = pd.Timestamp("2026-11-24 23:59:50") + pd.to_timedelta(np.arange(40), unit="s")
    table = good().assign(day=at.date, clock=at.time)
    np.testing.assert_array_equal(to_measured("log", table).table["time_s"], np.arange(40))


def test_dates_that_could_be_two_are_asked_for_and_read_as_said(tmp_path):
    path = tmp_path / "a.csv"
    stamped("2026-04-03 23:59:50", "%d/%m/%Y").to_csv(path, index=False)
    with pytest.raises(InputError, match="whether the dates in column Datum Zeit are day/month/"):
        read_measured(path)
    by_day = read_measured(path, {"time": "Datum Zeit [day/month/year]"})
    assert by_day.table["time_s"].iloc[-1] == 19.5
    by_month = read_measured(path, {"time": "Datum Zeit [month/day/year]"})
    assert by_month.table["time_s"].iloc[-1] == 19.5 + 30 * 86400  # from March to April
    stamped("2026-04-13 08:00:00", "%d/%m/%Y").to_csv(path, index=False)
    with pytest.raises(InputError, match="have the form day/month/year and time"):
        read_measured(path, {"time": "Datum Zeit [month/day/year]"})
    with pytest.raises(InputError, match="slip_ratio is said to hold dates"):
        read_measured(path, {"time": "slip_ratio [month/day/year]"})


def test_a_day_alone_is_no_time(tmp_path):
    stamped("2026-11-24 08:00:00", "%d.%m.%Y").drop(columns="Zeit").to_csv(tmp_path / "a.csv")
    found = read_measured(tmp_path / "a.csv")
    assert "time_s" not in found.table
    assert found.left_out == {}
    assert {*found.table["Datum"]} == {"24.11.2026"}


PREAMBLES = {
    "a line": "Logger 3000\n",
    "lines, cells and a blank line": "Logger 3000\nSerial;4711;x\n\nStart: 24.11.2026 08:00\n",
    "empty cells": "Measurement 5;;\n;;\n",
    "a cell over two lines": '"first\nsecond"\n',
    "sep=;": "sep=;\nLogger 3000\n",
}


@pytest.mark.parametrize("above", PREAMBLES)
@pytest.mark.parametrize("units", ["", "s;m/s;-;-\n"])
def test_lines_above_the_header_are_passed_over(above, units, tmp_path):
    path = tmp_path / "a.csv"
    table = good().round(6)
    table.insert(0, "v [km/h]" if not units else "v", 36.0 if not units else 10.0)
    table.insert(0, "t [s]" if not units else "t", 0.5 * np.arange(40))
    if units:
        table = table.rename(columns={"slip_ratio": "slip"})
    header, rows = table.to_csv(index=False, sep=";", decimal=",").split("\n", 1)
    preamble = PREAMBLES[above].replace(";;", ";;;")
    path.write_text(preamble + header + "\n" + units + rows)
    found = read_measured(path)
    np.testing.assert_allclose(found.table["vehicle_speed_mps"], 10.0)
    np.testing.assert_allclose(found.table["adhesion"], table["adhesion"], rtol=1e-12)
    first = preamble.count("\n") + 2 + bool(units)
    assert found.table.index[0] == first
    assert any(f"names of columns in row {preamble.count(chr(10)) + 1}" in x for x in found.notes)
    path.write_text(path.read_text() + "1;2;3;4;5\n")
    with pytest.raises(InputError, match=f"has 5 cells in row {first + 40} "):
        read_measured(path)


def test_a_time_of_day_goes_on_past_midnight(tmp_path):
    clock = pyarrow.array([time(23, 59, 59, 500000), None, time(0, 0, 0, 500000)])
    of_day = seconds(stamps(clock)[0], 0)
    np.testing.assert_array_equal(unwrapped(of_day, 86400.0), [86399.5, np.nan, 86400.5])
    table = good().assign(Uhrzeit=["23:59:40"] * 20 + ["00:00:01"] * 20)
    table.to_csv(tmp_path / "a.csv", index=False)
    found = read_measured(tmp_path / "a.csv").table["time_s"]
    assert found.iloc[-1] - found.iloc[0] == 21


def test_every_way_to_write_a_log_gives_the_same_numbers(tmp_path):
    """Semicolons, tabs, decimal commas, encodings, a row of units, quotes, compression, parquet."""
    plain = (
        good()
        .round(6)
        .assign(vehicle_speed_mps=10.0, temperature_C=20.5, time_s=0.25 * np.arange(40.0))
    )
    at = pd.Timestamp("2026-11-24 08:00:00") + pd.to_timedelta(plain["time_s"], unit="s")
    shown = pd.DataFrame(
        {
            "Zeit": at.dt.strftime("%d.%m.%Y %H:%M:%S,%f").str[:-3],
            "Schlupf": 100 * plain["slip_ratio"],
            "µ": plain["adhesion"],
            "Geschwindigkeit": 3.6 * plain["vehicle_speed_mps"],
            "Temp.": plain["temperature_C"] + 273.15,
        }
    )
    units = ["", "%", "-", "km/h", "K"]
    named_units = {
        name: f"{name} [{unit}]" for name, unit in zip(shown, units, strict=True) if unit
    }
    in_names = shown.rename(columns=named_units)
    head, _, rest = shown.to_csv(index=False, sep=";", decimal=",").partition("\n")
    with_row = f"{head}\n{';'.join(units)}\n{rest}"
    texts = {
        "units.csv": with_row.encode(),
        "sixteen.csv": with_row.encode("utf-16"),
        "windows.csv": with_row.encode("cp1252"),
        "mark.csv": b"\xef\xbb\xbf" + with_row.replace("\n", "\r\n").encode(),
        "tabs.tsv": in_names.to_csv(index=False, sep="\t").encode(),
        "bars.txt": in_names.to_csv(index=False, sep="|", decimal=",").encode(),
        "quoted.csv": in_names.astype(str).to_csv(index=False, quoting=1).encode(),
    }
    for name, content in texts.items():
        (tmp_path / name).write_bytes(content)
    in_names.assign(Zeit=at).to_parquet(tmp_path / "dated.parquet")
    in_names.to_csv(tmp_path / "packed.csv.gz", index=False)
    for path in sorted(tmp_path.iterdir()):
        found = read_measured(path).table
        for name in plain:
            np.testing.assert_allclose(
                found[name], plain[name], rtol=1e-12, atol=1e-12, err_msg=path
            )
        first = {"units.csv": 3, "sixteen.csv": 3, "windows.csv": 3, "mark.csv": 3}
        assert found.index[0] == first.get(path.name, 1 if path.suffix == ".parquet" else 2)
    frame = to_measured("the data frame", in_names.assign(Zeit=at)).table
    np.testing.assert_allclose(frame[[*plain]], plain, rtol=1e-12, atol=1e-12)


def test_what_was_understood_is_told(tmp_path):
    place, gear = ["x", *["3.5"] * 28, *["x"] * 11], [*["1"] * 3, "ERR", *["2"] * 36]
    table = good().assign(**{"v [km/h]": 36.0, "Ort": place, "n": gear})
    table.loc[3:4, "v [km/h]"] = np.nan
    table.to_csv(tmp_path / "a.csv", index=False, sep=";")
    found = read_measured(tmp_path / "a.csv")
    row = found.understood.set_index("taken_as").loc["vehicle_speed_mps"]
    assert (row["column"], row["unit"], row["lowest"], row["highest"]) == (
        "v [km/h]",
        "km/h",
        36,
        36,
    )
    assert row["missing"] == 2 / 40
    said = " ".join(found.notes)
    assert "semicolons" in said
    assert "1 value is text and not used: row 5 of column n has the text 'ERR'" in said
    assert "1 row of 40 (2.5 %), in which there is no value of vehicle_speed_mps" in said
    assert len(found.table) == 38
    assert found.left_out == {}
    assert found.table["Ort"].nunique() == 2


def test_rows_with_a_gap_are_left_out_and_counted():
    table = good(100).assign(wear=np.arange(100.0), rare=1.0)
    table.loc[[4, 9], "adhesion"] = np.nan
    table.loc[[4, 20, 21], "wear"] = np.nan
    table.loc[30:, "rare"] = np.nan
    found = to_measured("log", table)
    assert found.table.index.tolist() == [row for row in range(100) if row not in (4, 9, 20, 21)]
    assert found.covariates == ("wear",)
    said = " ".join(found.notes)
    assert "2 rows of 100 (2 %), in which there is no value of adhesion" in said
    assert "2 rows of 100 (2 %), in which there is no value of wear" in said
    assert (
        "The column rare is left out: 70 % of its rows have no value, and at most 5 % of all rows "
        "may." in said
    )


def test_sanding_may_be_written_as_a_flag():
    on, off = ("on", "YES", "true", "ein", "Ja", "1"), ("off", "No", "false", "Aus", "nein", "0")
    written = [word for pair in zip(on, off, strict=True) for word in pair]
    table = good(12).assign(Sander=written, rain=["on", "off"] * 6)
    found = to_measured("log", table)
    np.testing.assert_array_equal(found.table["sanding"], [1.0, 0.0] * 6)
    assert [*found.table["rain"]] == ["on", "off"] * 6  # what is no known flag keeps its labels
    assert found.left_out == {}
    wet = to_measured("log", table.assign(Sander=["damp", "wet"] * 6))
    why = (
        "row 0 of column Sander has the text 'damp' (write a number, with a decimal point, no unit)"
    )
    assert wet.left_out == {"sanding": why}


@pytest.mark.parametrize(
    ("column", "scale", "says"),
    [
        ("vehicle_speed_mps", 160.0, "vehicle_speed_mps: its largest value, 160 m/s"),
        ("normal_load_N", 106.0, "normal_load_N: its largest value, 106 N"),
        ("slip_ratio", None, "may be in per cent"),
    ],
)
def test_our_names_are_believed_and_sizes_of_another_unit_are_warned_of(column, scale, says):
    values = np.linspace(0.1, 1.4, 40) if scale is None else np.full(40, scale)
    found = to_measured("log", good().assign(**{column: values}))
    assert says in found.notes[-1]
    assert not to_measured("log", good().assign(vehicle_speed_mps=30.0)).notes


def test_what_the_user_says_goes_before_names(tmp_path):
    table = pd.DataFrame(
        {
            "v1 [km/h]": 36.0,
            "v": 40.0,
            "Schlupf": 100 * good()["slip_ratio"],
            "F [kN]": 200 * good()["adhesion"],
        }
    )
    table.to_csv(tmp_path / "a.csv", index=False)
    said = {
        "speed": "v1",
        "slip": "Schlupf [%]",
        "axle_force": "F [kN]",
        "axle_load": "200 kN",
    }
    (found,) = read_all([tmp_path / "a.csv"], said)
    np.testing.assert_allclose(found.table["slip_ratio"], good()["slip_ratio"], rtol=1e-14)
    np.testing.assert_allclose(found.table["adhesion"], good()["adhesion"], rtol=1e-14)
    assert (found.table["vehicle_speed_mps"] == 10).all()
    assert (found.table["normal_load_N"] == 1e5).all()
    assert found.covariates == ("v",)
    # A name of ours says the unit too; a unit beside it goes before both.
    for value, speed in (("v", 40.0), ("v [km/h]", 40 / 3.6), ("v1 [km/h]", 10.0)):
        ours = {name: one for name, one in said.items() if name != "speed"}
        found = to_measured("log", table, {**ours, "vehicle_speed_mps": value})
        np.testing.assert_allclose(found.table["vehicle_speed_mps"], speed, rtol=1e-14)
    with pytest.raises(InputError, match=r"in which unit the column v is .*--column"):
        to_measured("log", table, {**said, "speed": "v"})


def test_a_force_that_is_not_asked_for_explains_nothing():
    found = to_measured("log", good().assign(**{"Zugkraft [kN]": 200 * good()["adhesion"]}))
    assert "Zugkraft [kN]" not in found.table
    assert "may be a force" in found.notes[0]


def test_two_columns_of_one_quantity_are_asked_for():
    table = good().rename(columns={"slip_ratio": "slip [%]"}).assign(**{"Schlupf [%]": 1.0})
    with pytest.raises(
        InputError, match=r"which of the columns slip .* and Schlupf .* is the slip"
    ):
        to_measured("log", table)
    exact = good().assign(**{"Schlupf [%]": 1.0})
    assert (to_measured("log", exact).table["slip_ratio"] == good()["slip_ratio"]).all()


def test_parquet_with_broken_text_is_refused(tmp_path):
    broken = pyarrow.Array.from_buffers(
        pyarrow.string(),
        40,
        [None, pyarrow.py_buffer(np.arange(41, dtype=np.int32)), pyarrow.py_buffer(b"\xff" * 40)],
    )
    table = pyarrow.Table.from_pandas(good()).append_column("run", broken)
    pyarrow.parquet.write_table(table, tmp_path / "a.parquet")
    with pytest.raises(InputError, match="not a whole parquet file"):
        read_measured(tmp_path / "a.parquet")


@pytest.mark.parametrize(
    ("name", "quantity", "index"),
    [
        ("v_Rad1 [km/h]", "wheel_speed_mps", 1),
        ("v_Rad_2 [km/h]", "wheel_speed_mps", 2),
        ("wheel speed 3 [m/s]", "wheel_speed_mps", 3),
        ("Radgeschwindigkeit 4 [km/h]", "wheel_speed_mps", 4),
        ("v_Achse1 [km/h]", "wheel_speed_mps", 1),
        ("Z_Achse2 [kN]", "axle_force_N", 2),
        ("Zugkraft Achse 1 [kN]", "axle_force_N", 1),
        ("M_Motor4 [Nm]", "motor_torque_Nm", 4),
        ("mu_1", "adhesion", 1),
        ("slip_1 [%]", "slip_ratio", 1),
        ("v_Radar [km/h]", "vehicle_speed_mps", -1),
        ("v_GPS [km/h]", "vehicle_speed_mps", -1),
        ("v_ref [m/s]", "vehicle_speed_mps", -1),
        ("ground speed [mph]", "vehicle_speed_mps", -1),
        ("SRR (%)", "slip_ratio", -1),
        ("slide-roll ratio [%]", "slip_ratio", -1),
        ("kappa [-]", "slip_ratio", -1),
        ("longitudinal slip [%]", "slip_ratio", -1),
        ("COF", "adhesion", -1),
        ("friction coefficient", "adhesion", -1),
        ("Coefficient of friction", "adhesion", -1),
        ("Reibungszahl", "adhesion", -1),
        ("Traction Coefficient (-)", "adhesion", -1),
        ("Run", "run", -1),
        ("Axle", "axle", -1),
        ("Mode", "mode", -1),
        ("Wheel speed (rpm)", "wheel_rotation_radps", -1),
        ("Wheel speed [km/h]", "wheel_speed_mps", -1),
        ("Locomotive speed (mph)", "vehicle_speed_mps", -1),
        ("v_x [m/s]", "vehicle_speed_mps", -1),
        ("Sliding speed (mm/s)", "slip_velocity_mps", -1),
        ("Axle weight (t)", "axle_load_N", -1),
        ("Test no.", "run", -1),
        ("Vitesse roue (tr/min)", "wheel_rotation_radps", -1),
        ("Vitesse de la roue (km/h)", "wheel_speed_mps", -1),
        ("Glissement (%)", "slip_ratio", -1),
        ("Coefficient d'adhérence", "adhesion", -1),
        ("Charge à l'essieu [kN]", "axle_load_N", -1),
        ("Velocità treno [km/h]", "vehicle_speed_mps", -1),
        ("Aderenza", "adhesion", -1),
        ("Velocidad rueda (km/h)", "wheel_speed_mps", -1),
        ("Peso por eje (t)", "axle_load_N", -1),
        # The force of a brake or of a contact is that of a body that its name does not tell.
        ("Brake force (kN)", "", -1),
        ("Effort de traction (kN)", "", -1),
        ("Wheel speed", "", -1),
        # An index is no unit, and says nothing of what has no unit.
        ("slip_1", "", 1),
        ("v_Rad1", "", 1),
    ],
)
def test_names_of_loggers_and_rigs_are_known_with_their_index(name, quantity, index):
    found = guess(name)
    assert (found.quantity, found.number) == (quantity, index)
    if not quantity:
        assert found.question


def test_a_numbered_x_is_no_position():
    assert guess("x").quantities == ("position_m",)
    for name in ("x1", "x01", "X_12"):
        found = guess(name)
        assert (found.quantity, found.question, found.number) == ("", "", -1)


def test_several_columns_of_one_quantity_are_a_question_with_its_answers():
    table = (
        good()
        .drop(columns="slip_ratio")
        .assign(**{"v [km/h]": 36.0, "v_GPS [km/h]": 36.1, "v_Rad [km/h]": 37.0})
    )
    with pytest.raises(InputError) as refused:
        to_measured("log", table)
    for name in ("v [km/h]", "v_GPS [km/h]"):
        assert f'--column "vehicle_speed={name}"' in str(refused.value)
    found = to_measured("log", table, {"vehicle_speed": "v [km/h]"})
    np.testing.assert_allclose(found.table["slip_ratio"], 1 / 36, rtol=1e-12)


def test_a_minus_before_a_column_turns_its_sign():
    """A tyre rig in the axes of SAE: the load is negative, and the force of the other sign."""
    table = pd.DataFrame(
        {"SL": good()["slip_ratio"], "FX": -650 * good()["adhesion"], "FZ [N]": -650.0}
    )
    said = {"slip": "SL [1]", "wheel_force": "-FX [N]", "wheel_load": "-FZ"}
    found = to_measured("rig", table, said)
    np.testing.assert_allclose(found.table["adhesion"], good()["adhesion"], rtol=1e-12)
    assert (found.table["normal_load_N"] == 650).all()
    load = found.understood.set_index("taken_as").loc["normal_load_N"]
    assert (load["lowest"], load["highest"]) == (-650, -650)
    with pytest.raises(InputError, match=r'turn its sign, as by --column "wheel_load=-FZ"'):
        to_measured("rig", table, {**said, "wheel_load": "FZ"})
    # A number is a constant, and a column that begins with a minus is that column.
    with pytest.raises(InputError, match="lies outside"):
        to_measured("rig", table, {**said, "wheel_load": "-650 N"})
    own = table.rename(columns={"FX": "-FX"})
    with pytest.raises(InputError, match="of the other sign"):
        check_curve(to_measured("rig", own, {**said, "wheel_force": "-FX [N]"}))


HEADERS = {
    "a mark of a comment": ("# time(s),v (m/s),slip (%),mu\n", ","),
    "lines of comments": ("# rig 7\n# 24.11.2026\n# time(s);v (m/s);slip (%);mu\n", ";"),
    "groups, names, units": ("Log;Log;Rad 1;Rad 1\nZeit;v;Schlupf;mu\ns;m/s;%;-\n", ";"),
    "groups over empty cells": ("Log;;Rad;\nZeit;v;Schlupf;mu\n[s];[m/s];[%];[-]\n", ";"),
    "names and units": ("Zeit\tv\tSchlupf\tmu\n[s]\t[m/s]\t[%]\t[-]\n", "\t"),
}


@pytest.mark.parametrize("ending", [".csv", ".dat", ".asc"])
@pytest.mark.parametrize("header", HEADERS)
def test_headers_of_one_to_three_rows_are_read(header, ending, tmp_path):
    head, mark = HEADERS[header]
    table = pd.DataFrame(
        {"t": 0.5 * np.arange(40), "v": 10.0, "s": 100 * good()["slip_ratio"]}
    ).assign(mu=good()["adhesion"])
    text = table.to_csv(index=False, header=False, sep=mark)
    (tmp_path / f"a{ending}").write_text(head + text)
    found = read_measured(tmp_path / f"a{ending}")
    for name, column in (("time_s", "t"), ("vehicle_speed_mps", "v"), ("adhesion", "mu")):
        np.testing.assert_allclose(found.table[name], table[column], rtol=1e-12)
    np.testing.assert_allclose(found.table["slip_ratio"], good()["slip_ratio"], rtol=1e-12)
    assert found.table.index[0] == head.count("\n") + 1


def test_cells_may_be_separated_by_any_number_of_spaces(tmp_path, monkeypatch):
    """As `numpy.savetxt` and programs that align columns write them."""
    monkeypatch.setattr("adhesion_jax.data.dialect._CHUNK", 100)
    table = good().round(6).assign(day="24.11.2026", clock="08:00:00", rail="R 1")
    table["clock"] = [f"08:00:{row:02d}" for row in range(40)]
    aligned = table.drop(columns="rail").to_string(index=False)
    numbers = io.StringIO()
    np.savetxt(numbers, good(), header="slip_ratio adhesion")
    texts = {
        "aligned.txt": aligned,
        "commas.dat": aligned.replace("0.", "0,") + "  \r\n",
        "numpy.txt": numbers.getvalue(),
        "logger.asc": "Logger 3000\n\n" + aligned.replace("\n", " \n"),
        "quoted.dat": table.to_csv(index=False, sep=" ", quoting=1),
    }
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
        found = read_measured(tmp_path / name)
        assert any("cells separated by spaces" in note for note in found.notes), name
        np.testing.assert_allclose(found.table["slip_ratio"], good()["slip_ratio"], atol=1e-6)
        np.testing.assert_allclose(found.table["adhesion"], good()["adhesion"], atol=1e-6)
        if "time_s" in found.table:
            np.testing.assert_array_equal(np.diff(found.table["time_s"]), 1)
        else:
            assert name == "numpy.txt"
    (tmp_path / "ragged.dat").write_text(
        f"{aligned}\n0.1 0.2\n" + 3 * "0.1 0.2 24.11.2026 8:00:00\n"
    )
    with pytest.raises(InputError, match="has 2 cells in row 42 where its header has 4 columns"):
        read_measured(tmp_path / "ragged.dat")


def test_names_that_stand_there_twice_are_told_apart_by_their_group(tmp_path):
    rows = good().assign(v1=36.0, v2=36.5).to_csv(index=False, header=False, sep=";")
    (tmp_path / "a.csv").write_text(
        "Rig;;Radar;GPS\nslip_ratio;adhesion;v;v\n-;-;km/h;km/h\n" + rows
    )
    found = read_measured(tmp_path / "a.csv", {"speed": "Radar v"})
    np.testing.assert_allclose(found.table["vehicle_speed_mps"], 10.0)
    assert "GPS v" in found.table


def test_a_quantity_may_be_what_groups_go_by():
    slip = np.linspace(0.002, 0.12, 40)
    load = np.where(np.arange(40) < 20, 90.0, 100.0)
    frame = pd.DataFrame(
        {"slip_ratio": slip, "Radkraft [kN]": load * slip, "Radlast [kN]": load}
    ).assign(Wetter="trocken")
    for by in ("Radlast [kN]", "Radlast"):
        table = to_measured("a", frame, {"group": by}).table
        assert table["normal_load_N"].tolist() == (1e3 * load).tolist()
        assert table["group"].astype(float).tolist() == load.tolist()
    table = to_measured("a", frame, {"group": "Wetter"}).table
    assert set(table["group"]) == set(table["Wetter"]) == {"trocken"}
