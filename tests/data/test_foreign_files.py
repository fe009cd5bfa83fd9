"""Spreadsheets, MATLAB, HDF5, MDF, TDMS, feather and zip: the log that the libraries wrote."""

import zipfile

import asammdf
import nptdms
import numpy as np
import pandas as pd
import pytest
import scipy.io
from foreign_logs import (
    DRIVER,
    FOREIGN,
    GEARS,
    LOG,
    NAMES,
    ROWS,
    TIME,
    VARIABLES,
    tdms_of_two_starts,
    written,
)

from adhesion_jax.data import read_measured, to_measured
from adhesion_jax.data.files import sheet_of_file
from adhesion_jax.errors import InputError


def tell(ending, place, tmp_path):
    """What is read of it, and what is said."""
    found = read_measured(written(tmp_path, ending, place))
    return found.table, " ".join(found.notes)


@pytest.mark.parametrize(
    ("ending", "place"),
    [
        pytest.param(ending, place, marks=pytest.mark.long if place else ())
        for ending in FOREIGN
        for place in range(len(FOREIGN[ending]))
    ],
)
def test_what_the_libraries_wrote_is_read(ending, place, tmp_path):
    table, notes = tell(ending, place, tmp_path)
    # The speed rises evenly: a straight line between its samples is exact, up to the last of them.
    slow = (
        "with 2 clocks, on the times of those that have most samples: the others by straight lines"
    )
    rows = ROWS - 9 if slow in notes else ROWS
    assert (slow in notes) == (ending in (".mf4", ".tdms") and place >= len(FOREIGN[ending]) - 2)
    log = LOG[:rows]
    assert len(table) == rows
    size = 1e-6 if ending in (".xlsx", ".feather") else 1e-9  # dates, and single precision
    np.testing.assert_allclose(table["time_s"], log["Zeit [s]"], size, size)
    np.testing.assert_allclose(table["vehicle_speed_mps"], log["v [km/h]"] / 3.6, size)
    slip = log["v_Rad [km/h]"] / log["v [km/h]"] - 1
    np.testing.assert_allclose(table["slip_ratio"], slip, size, size)
    np.testing.assert_allclose(table["adhesion"], log["mu"], size, size)


@pytest.mark.parametrize("ending", [".xlsx", ".ods"])
def test_of_a_workbook_the_largest_sheet_is_read_and_named(ending, tmp_path):
    table, notes = tell(ending, 1, tmp_path)
    said = "The log has the sheet Daten, decimal points, names of columns in row 2, units in row 3."
    assert said in notes
    assert table.index[0] == 4


def test_vectors_of_other_lengths_are_told(tmp_path):
    _, notes = tell(".mat", 2, tmp_path)
    assert "4 vectors of length 200, and 1 of other lengths that are not read: c." in notes


@pytest.mark.parametrize("ending", [".mf4", ".tdms"])
def test_states_have_the_value_before(ending, tmp_path):
    table, _ = tell(ending, -1, tmp_path)
    rows = np.arange(len(table)) // 10
    np.testing.assert_array_equal(table["gear"], GEARS[rows])
    assert [*table["driver"]] == [DRIVER[row] for row in rows]


def test_channels_that_start_later_are_at_their_time(tmp_path):
    tdms_of_two_starts(tmp_path / "log.tdms")
    table = read_measured(tmp_path / "log.tdms").table
    log = LOG[20:]
    np.testing.assert_allclose(table["time_s"], log["Zeit [s]"], atol=1e-9)
    np.testing.assert_allclose(table["vehicle_speed_mps"], log["v [km/h]"] / 3.6, 1e-9)
    np.testing.assert_allclose(table["adhesion"], log["mu"], 1e-9, 1e-9)


def test_labels_are_kept(tmp_path):
    assert "rail" in tell(".feather", 2, tmp_path)[0]
    assert "rail" in tell(".h5", 1, tmp_path)[0]


def test_a_zip_file_with_two_tables_is_refused(tmp_path):
    path = written(tmp_path, ".zip", 0)
    with zipfile.ZipFile(path, "a") as file:
        file.writestr("two.csv", "x")
    with pytest.raises(InputError, match=r"one table of text, and has log.csv and two.csv; unpack"):
        read_measured(path)


@pytest.mark.parametrize("ending", FOREIGN)
@pytest.mark.parametrize("content", [b"PK", b"nothing of the kind", bytes(range(256)) * 20])
def test_what_is_none_of_them_is_refused_in_a_sentence(ending, content, tmp_path):
    path = tmp_path / f"log{ending}"
    path.write_bytes(content)
    with pytest.raises(InputError) as refused:
        read_measured(path)
    assert "\n" not in str(refused.value)
    assert str(refused.value).startswith((f"{path} is not a whole ", f"{path} has no vectors"))


@pytest.mark.parametrize(
    ("ending", "place", "package"),
    [(".h5", 0, "h5py"), (".mat", -1, "h5py"), (".mf4", 0, "asammdf"), (".tdms", 0, "nptdms")],
)
def test_a_library_that_is_lacking_is_named_with_what_installs_it(
    ending, place, package, tmp_path, monkeypatch
):
    path = written(tmp_path, ending, place)
    (tmp_path / f"{package}.py").write_text(f"raise ModuleNotFoundError(name='{package}')")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    with pytest.raises(InputError, match=rf"needs the package {package}.*adhesion-jax\[files\]"):
        read_measured(path)


def test_so_is_that_of_spreadsheets(tmp_path, monkeypatch):
    path = written(tmp_path, ".xlsx", 0)
    monkeypatch.setattr("adhesion_jax.data.containers.find_spec", lambda _: None)
    with pytest.raises(InputError, match=r"needs the package python-calamine.*\[files\]"):
        read_measured(path)


def test_channels_of_one_name_keep_that_of_their_group(tmp_path):
    """Two clocks of as many samples, one of them later, and a channel that both have."""
    file = asammdf.MDF()
    for late in (0.0, 0.02):
        time = TIME + late
        values = {"v": 36.0 + time, "temp": 20 + time} if late else {"temp": 8.0 + 0 * time}
        signals = [asammdf.Signal(one, time, name=name) for name, one in values.items()]
        file.append(signals, acq_name="CAN")
    file.save(tmp_path / "log.mf4")
    sheet = sheet_of_file(tmp_path / "log.mf4")
    assert sheet.columns == ("time [s]", "CAN 0/temp", "v", "CAN 1/temp")
    assert "3 channels with 2 clocks" in sheet.format
    ((block, _),) = sheet.blocks()
    assert block["v"][0].as_py() is None
    assert block["v"][1].as_py() == pytest.approx(36.05)


def test_nothing_is_invented_while_a_channel_is_not_recorded(tmp_path):
    """Adhesion and a gear at 10 Hz that stop for 15 s; a state that is sent on change goes on."""
    time = 0.1 * np.arange(300)
    known = (time < 5) | (time > 20)
    sent = np.array([0.0, 0.3, 25.0, 25.2, 29.0])
    file = asammdf.MDF()
    for at, signals in (
        (time, {"v": 36 + time}),
        (time[known], {"mu": 0.2 + 0 * time[known], "gear": np.full(known.sum(), 3)}),
        (sent, {"brake": np.array([0, 1, 2, 3, 4])}),
    ):
        file.append([asammdf.Signal(values, at, name=name) for name, values in signals.items()])
    file.save(tmp_path / "log.mf4")
    ((block, _),) = sheet_of_file(tmp_path / "log.mf4").blocks()
    for name, value in (("mu", 0.2), ("gear", 3.0)):
        values = block[name].to_numpy(zero_copy_only=False)
        np.testing.assert_array_equal(values, np.where(known, value, np.nan))
    assert {*block["brake"].to_numpy(zero_copy_only=False)[3:250]} == {1.0}


@pytest.mark.parametrize(
    "index",
    [
        pd.date_range("2026-11-24", periods=ROWS, freq="50ms"),
        pd.to_timedelta(TIME, unit="s"),
        pd.Index(TIME, name="t [s]"),
    ],
    ids=["dates", "durations", "named"],
)
def test_an_index_of_times_is_a_column(index, tmp_path):
    """As pandas keeps it, and as it writes it."""
    table = LOG.drop(columns="Zeit [s]").set_index(index)
    table.to_parquet(tmp_path / "log.parquet")
    found = [to_measured("log", table), read_measured(tmp_path / "log.parquet")]
    if not isinstance(index, pd.TimedeltaIndex):  # as "0 days 00:00:00.05" in a CSV
        table.to_csv(tmp_path / "log.csv")
        found.append(read_measured(tmp_path / "log.csv"))
    for one in found:
        np.testing.assert_allclose(one.table["time_s"], TIME, atol=1e-9)
    # One that only counts the rows is none, and one that is a column too is that.
    kept = to_measured("log", LOG.set_index("Zeit [s]", drop=False))
    assert [*kept.understood["column"]] == [*to_measured("log", LOG).understood["column"]]


def test_a_channel_of_stamps_is_the_time(tmp_path):
    """As LabVIEW writes it where it does not keep the step."""
    at = np.datetime64("2026-11-24T08:00:00.000000") + (1e6 * TIME).astype("timedelta64[us]")
    with nptdms.TdmsWriter(tmp_path / "log.tdms") as file:
        for name, (stem, unit) in NAMES.items():
            values, told = LOG[name].to_numpy(), {"unit_string": unit}
            if stem == "Zeit":
                values, told = at, {}
            file.write_segment([nptdms.ChannelObject("a", stem, values, told)])
    found = read_measured(tmp_path / "log.tdms")
    np.testing.assert_allclose(found.table["time_s"], TIME, atol=1e-6)
    assert "The time counts from 2026-11-24 08:00:00." in found.notes


def test_what_is_no_vector_is_named(tmp_path):
    more = {"map": np.ones((3, 4)), "spectrum": 1j * TIME, "rate": 20.0, "who": "Ada"}
    scipy.io.savemat(tmp_path / "log.mat", VARIABLES | more)
    said = sheet_of_file(tmp_path / "log.mat").format
    assert said == (
        "4 vectors of length 200; what is no vector of real numbers, text or dates is not read: "
        "map and spectrum"
    )


@pytest.mark.parametrize(
    "cell", [[1.0, 2.0], {"a": 1}, b"\xff\xfe"], ids=["list", "struct", "bytes"]
)
def test_columns_of_neither_numbers_nor_text(cell, tmp_path):
    LOG.assign(more=[cell] * ROWS).to_parquet(tmp_path / "log.parquet")
    assert read_measured(tmp_path / "log.parquet").left_out.keys() == {"more"}
    with pytest.raises(InputError, match=r"column more holds no numbers and no text, which labels"):
        read_measured(tmp_path / "log.parquet", {"run": "more"})
    LOG.assign(mu=[cell] * ROWS).to_parquet(tmp_path / "log.parquet")
    with pytest.raises(InputError, match="row 1 of column mu has the text"):
        read_measured(tmp_path / "log.parquet")


def test_a_label_may_be_any_number():
    found = to_measured("log", LOG.assign(run=np.repeat([np.inf, 1e20], ROWS // 2)))
    assert [*found.table["run"].unique()] == ["inf", "1e+20"]


def test_text_with_decimal_commas_beside_numbers_of_a_sheet(tmp_path):
    """Three digits behind the comma might part thousands, were the mark that of the other cells."""
    at = np.arange(1000, 5000, 20)
    slip = [f"{size / 1000:.3f}".replace(".", ",") for size in at]
    LOG[["mu"]].assign(**{"Schlupf [%]": ["0,995", *slip[1:]]}).to_excel(f"{tmp_path}/log.xlsx")
    found = read_measured(tmp_path / "log.xlsx").table
    np.testing.assert_allclose(found["slip_ratio"], [0.00995, *at[1:] / 1e5])
