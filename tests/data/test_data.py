import gzip
import sys

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adhesion_jax.command_line.command import run
from adhesion_jax.command_line.identify import main
from adhesion_jax.data import SHIPPED, read_measured, to_record
from adhesion_jax.data.columns import COLUMNS, LABELS


def good(rows=12):
    slip = np.linspace(0.01, 0.12, rows)
    return pd.DataFrame({"slip_ratio": slip, "adhesion": 0.3 * slip / (0.02 + slip)})


def written(tmp_path, table, name="set.csv"):
    path = tmp_path / name
    table.to_csv(path, index=False)
    return path


def refusal(path, capsys, monkeypatch, *options):
    """What the command says about a file it must refuse: status 2, one line, no traceback."""
    monkeypatch.setattr(sys, "argv", ["identify", str(path), "--out", str(path) + "-out", *options])
    with pytest.raises(SystemExit) as ended:
        run(main)
    assert ended.value.code == 2
    said = capsys.readouterr()
    # Nothing is printed but how the columns are understood, where that much can be said.
    first = said.out.split("\n")[0]
    assert first in ("", "Columns as understood so far:") or first.endswith(" are used.")
    assert said.err.startswith("error: ")
    assert said.err.endswith(".\n")
    assert said.err.count("\n") == 1
    assert "Traceback" not in said.err
    return said.err


def test_the_shipped_set_is_the_measured_one():
    measured = read_measured(SHIPPED["eurosprinter"].path)
    assert len(measured.table) == 163
    assert measured.slip == "slip_ratio"
    assert (measured.covariates, measured.left_out) == ((), {})
    # 36 km/h and 106.7 kN a wheel, as the paper has them.
    assert (measured.table["vehicle_speed_mps"] == 10).all()
    assert (measured.table["normal_load_N"] == 106700).all()
    # Digitised to .03 % creep: slip ratio and slip velocity agree to their last digit.
    ratio = measured.table["slip_velocity_mps"] / 10
    np.testing.assert_allclose(measured.table["slip_ratio"], ratio, atol=1e-6)
    assert "Engel, Beck and Alders" in SHIPPED["eurosprinter"].citation


@pytest.mark.parametrize("name", ["a.csv", "b.csv.gz", "c.parquet", "D.CSV"])
def test_every_kind_of_file_gives_the_same_record(tmp_path, name):
    path, table = tmp_path / name, good()
    if name.endswith("parquet"):
        table.to_parquet(path)
    elif name.endswith("gz"):
        path.write_bytes(gzip.compress(table.to_csv(index=False).encode()))
    else:
        # A byte order mark, spaces around names and a saved index are what spreadsheets leave.
        text = table.to_csv().replace("slip_ratio", " slip_ratio ")
        path.write_bytes(b"\xef\xbb\xbf" + text.replace("\n", "\r\n").encode())
    record = to_record(read_measured(path))
    np.testing.assert_allclose(record.slip, table["slip_ratio"], rtol=1e-15)
    np.testing.assert_allclose(record.adhesion, table["adhesion"], rtol=1e-15)
    assert record.mask.all()


def test_what_is_missing_is_derived(tmp_path):
    table = good()
    load, speed = 1e5, np.linspace(8, 12, 12)
    force = pd.DataFrame(
        {
            "slip_velocity_mps": table["slip_ratio"] * speed,
            "vehicle_speed_mps": speed,
            "tangential_force_N": table["adhesion"] * load,
            "normal_load_N": load,
        }
    )
    measured = read_measured(written(tmp_path, force))
    assert measured.slip == "slip_ratio"
    np.testing.assert_allclose(measured.table["slip_ratio"], table["slip_ratio"], rtol=1e-14)
    np.testing.assert_allclose(measured.table["adhesion"], table["adhesion"], rtol=1e-14)

    both = table.assign(slip_velocity_mps=table["slip_ratio"] * speed)
    both.loc[3, ["slip_ratio", "slip_velocity_mps", "adhesion"]] = 0.0
    derived = read_measured(written(tmp_path, both)).table["vehicle_speed_mps"]
    np.testing.assert_allclose(derived.drop(5), np.delete(speed, 3), rtol=1e-14)
    assert 8 <= derived[5] <= 12

    velocity = read_measured(
        written(tmp_path, table.rename(columns={"slip_ratio": "slip_velocity_mps"}))
    )
    assert velocity.slip == "slip_velocity_mps"
    assert (to_record(velocity).conditions["vehicle_speed_mps"] == 1).all()


def test_the_ratio_wins_over_the_velocity(tmp_path):
    table = good().assign(slip_velocity_mps=7.0, vehicle_speed_mps=10.0)
    measured = read_measured(written(tmp_path, table))
    np.testing.assert_allclose(to_record(measured).slip, good()["slip_ratio"])


def test_further_numeric_columns_are_covariates_and_text_is_labels(tmp_path):
    table = good().assign(rail_age_days=3.5, gap=[np.nan, *range(11)], note="dry", mode="traction")
    # One row of twelve is more than 5 %: the column is left out, and not the row.
    measured = read_measured(written(tmp_path, table))
    assert measured.covariates == ("rail_age_days",)
    assert measured.left_out.keys() == {"gap"}
    assert measured.table["note"].tolist() == ["dry"] * 12
    conditions = to_record(measured).conditions
    assert (conditions["rail_age_days"] == 3.5).all()
    assert not {"mode", "note"} & {*conditions}


@given(st.sampled_from(sorted(COLUMNS)), st.floats(1e-9, 1e9), st.booleans())
def test_no_value_outside_its_range_is_used(tmp_path_factory, name, excess, above):
    column = COLUMNS[name]
    bound = column.upper if above else column.lower
    value = bound + excess * (1 if above else -1)
    if not np.isfinite(bound) or value == bound:
        return
    table = good().assign(vehicle_speed_mps=10.0)
    table.loc[4, name] = value
    table[name] = table[name].fillna(np.clip(1.0, column.lower, column.upper))
    # By chance the value may lie within five times of what the others have.
    if name in ("slip_ratio", "adhesion") and abs(value) <= 3.0:
        return
    found = read_measured(written(tmp_path_factory.mktemp("range"), table), few=0.2)
    assert 6 not in found.table.index or name not in found.table
    assert f"row 6 of column {name} has" in " ".join(found.notes)


def cells(column, row, value, rows=1):
    """A good table with cells from a row, which a user sees, on replaced (the header is row 1)."""
    table = good().assign(normal_load_N=1e5, time_s=np.arange(12.0)).astype(object)
    table["tangential_force_N"] = 1e5 * table.pop("adhesion")
    table.loc[row - 2 : row - 3 + rows, column] = value
    return table.to_csv(index=False)


FORCE = "tangential_force_N"
FAULTS = {
    "text": (cells(FORCE, 5, "3e4 N", 4), [FORCE, "row 5", "'3e4 N'", "number"]),
    "infinite": (cells("slip_ratio", 2, "inf", 4), ["there are 8 points", "at least 10"]),
    "per cent": (cells("slip_ratio", 8, 7.5, 4), ["slip_ratio", "1.5", "per cent"]),
    "adhesion in per cent": (
        good().assign(adhesion=28.0).to_csv(),
        ["the adhesion is 28", "per cent", '"adhesion=adhesion [1]"'],
    ),
    "force in kN": (cells(FORCE, 2, 20, 12), ["the adhesion is 0.0002", "units of force and load"]),
    "no load": (cells("normal_load_N", 4, 0, 4), ["normal_load_N", "row 4", "positive"]),
    "negative load": (
        cells("normal_load_N", 2, -1e5, 12),
        ["normal_load_N", "row 2", "positive", '--column "wheel_load=-FZ"'],
    ),
    "time runs back": (
        good().assign(time_s=[5.0, 4.0, 3.0] * 4).to_csv(),
        ["time_s", "decreases all the time, first in row 3"],
    ),
    "empty file": ("", ["is empty", "header"]),
    "blank file": ("\n \n", ["is empty", "header"]),
    "header only": ("slip_ratio,adhesion\n", ["no point", "at least 10"]),
    "one point": ("slip_ratio,adhesion\n0.1,0.3\n", ["one point", "at least 10"]),
    "few points": (good(5).to_csv(), ["5 points", "at least 10"]),
    "no slip": ("slip,adhesion\n" + 12 * "0.1,0.3\n", ["slip_ratio", "missing", "slip, adhesion"]),
    "no adhesion": ("slip_ratio\n" + 12 * "0.1\n", ["adhesion", "tangential_force_N", "missing"]),
    "force without load": (
        good().rename(columns={"adhesion": "tangential_force_N"}).to_csv(),
        ["tangential_force_N alone", "normal_load_N", "missing"],
    ),
    "twice": ("slip_ratio,adhesion,adhesion\n0.1,0.3,0.3\n", ["adhesion twice", "own name"]),
    "ragged": (good().to_csv(index=False) + "0.1\n", ["1 cell in row 14", "2 columns"]),
    "open quote": ('slip_ratio,"adhesion\n0.1,0.3\n', ["from row 1 on", "unexpected end of data"]),
    "constant slip": ("slip_ratio,adhesion\n" + 12 * "0.1,0.3\n", ["slips of one size alone"]),
    "wrong sign": (
        good().assign(adhesion=-good()["adhesion"]).to_csv(),
        ["adhesion", "other sign", "braking"],
    ),
    "at rest": (
        good()
        .rename(columns={"slip_ratio": "slip_velocity_mps"})
        .assign(vehicle_speed_mps=[0.0] * 6 + [-0.4] * 6)
        .to_csv(),
        ["the slip is mostly noise", "in every row", "check the unit and the sign"],
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_bad_text_is_refused_in_one_sentence(fault, tmp_path, capsys, monkeypatch):
    text, names = FAULTS[fault]
    path = tmp_path / "bad.csv"
    path.write_text(text)
    said = refusal(path, capsys, monkeypatch)
    for name in ("bad.csv", *names):
        assert name in said


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("a.csv", bytes(range(256)), "binary file"),
        ("a.csv", "slip_ratio,adhesion\n0.1,0.3 ü\n".encode("latin-1"), "has the text '0.3 ü'"),
        ("a.csv.gz", b"slip_ratio,adhesion\n", "not a whole gzip file"),
        ("a.csv.gz", gzip.compress(good().to_csv().encode())[:-20], "not a whole gzip file"),
        ("a.parquet", b"PAR1 and no more", "not a whole parquet file"),
        ("a.parquet", b"", "is empty"),
        ("a.json", b"{}", "the ending of"),
        ("a.json", b"{}", ".mdf, .tdms or .feather file."),
    ],
)
def test_bad_bytes_are_refused_in_one_sentence(name, content, says, tmp_path, capsys, monkeypatch):
    path = tmp_path / name
    path.write_bytes(content)
    assert says in refusal(path, capsys, monkeypatch)


def test_a_file_that_is_not_there_is_refused(tmp_path, capsys, monkeypatch):
    assert "does not exist" in refusal(tmp_path / "none.csv", capsys, monkeypatch)
    (tmp_path / "folder.csv").mkdir()
    assert "has no file that can be read" in refusal(tmp_path / "folder.csv", capsys, monkeypatch)


def test_all_faults_are_reported_at_once_each_where_it_first_is(tmp_path, capsys, monkeypatch):
    table = good().assign(normal_load_N=1e5, wheel_speed_mps=10.0, vehicle_speed_mps=10.0)
    table = table.drop(columns="slip_ratio").astype(object)
    table.loc[[2, 5, 6, 7], "adhesion"] = "wet"
    table.loc[[4, 6, 7, 8], "wheel_speed_mps"] = 900.0
    table.loc[[3, 6, 7, 8], "vehicle_speed_mps"] = -900.0
    said = refusal(written(tmp_path, table), capsys, monkeypatch)
    for part in (
        "row 4 of column adhesion has the text 'wet'",
        "row 6 of column wheel_speed_mps has 900 m/s, outside -250 to 250 m/s",
        "row 5 of column vehicle_speed_mps has -900 m/s, outside -200 to 200 m/s",
    ):
        assert part in said
    assert said.count(" of column ") == 3


def test_time_may_begin_anew_with_a_new_run(tmp_path):
    table = good().assign(time_s=[*range(6), *range(6)], run=["a"] * 6 + ["b"] * 6)
    assert len(read_measured(written(tmp_path, table)).table) == 12
    # Without a run the log is cut there: times go on, behind a gap.
    found = read_measured(written(tmp_path, table.drop(columns="run")))
    assert (np.diff(found.table["time_s"]) > 0).all()
    assert "The time of column time_s begins anew in row 8: the log is cut" in " ".join(found.notes)


def test_rows_of_a_parquet_file_are_counted_from_one(tmp_path):
    table = good()
    table.loc[3, "adhesion"] = np.inf
    table.to_parquet(tmp_path / "a.parquet")
    found = read_measured(tmp_path / "a.parquet")
    assert "1 value is infinite and not used: row 4 of column adhesion." in found.notes
    assert found.table.index.tolist() == [1, 2, 3, *range(5, 13)]


def test_identify_refuses_the_roller_rig_by_its_name(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    said = refusal("roller-rig", capsys, monkeypatch)
    assert said.startswith("error: roller-rig cannot be used: column slip_ratio has slips of one ")


def test_the_known_columns_are_those_promised():
    promised = (
        "time_s run vehicle_speed_mps slip_ratio slip_velocity_mps adhesion tangential_force_N "
        "normal_load_N temperature_C relative_humidity_pct position_m curvature_per_m "
        "angle_of_attack_deg sanding axle mode acceleration_mps2 wheel_angle_rad "
        "slip_angle_deg lateral_creepage wheel_speed_mps wheel_rotation_radps axle_force_N "
        "axle_load_N locomotive_force_N locomotive_load_N driven_axles adhesion_sd motor_torque_Nm "
        "file group repeats"
    )
    assert {*COLUMNS, *LABELS} == {*promised.split()}
