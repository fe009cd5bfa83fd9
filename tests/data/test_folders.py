"""A folder of files, or a pattern of their names, is one log."""

import numpy as np
import pandas as pd
import pytest

import adhesion_jax as aj
from adhesion_jax.command_line import reading
from adhesion_jax.data import read_measured
from adhesion_jax.data.files import WANTED
from adhesion_jax.data.grouping import group
from adhesion_jax.errors import InputError

ROWS = 240
TIME = 0.05 * np.arange(ROWS)
SLIP = 0.05 * (1 - np.cos(2 * TIME))
LOG = pd.DataFrame(
    {"t [s]": TIME, "v [km/h]": 36.0, "slip [%]": 100 * SLIP, "mu": 0.3 * SLIP / (0.02 + SLIP)}
)


def parts(folder, names=("run 1.csv", "run 2.csv", "run 10.csv"), change=lambda part, _: part):
    """The log cut into files; hidden files and those of other kinds are none of it."""
    folder.mkdir()
    for place, name in enumerate(names):
        part = LOG.iloc[place * ROWS // len(names) : (place + 1) * ROWS // len(names)]
        change(part, place).to_csv(folder / name, index=False)
    (folder / ".hidden.csv").write_text("x")
    (folder / "notes.md").write_text("x")
    return folder


@pytest.mark.parametrize("named", ["", "run*.csv"])
def test_the_files_of_a_folder_or_a_pattern_are_one_log(named, tmp_path):
    path = parts(tmp_path / "logs") / named
    found = read_measured(path)
    np.testing.assert_allclose(found.table["slip_ratio"], SLIP, atol=1e-12)
    np.testing.assert_allclose(found.table["time_s"], TIME, atol=1e-12)
    # Run 2 stands before run 10, and the log goes on from one to the next.
    assert found.table["file"].unique().tolist() == ["run 1.csv", "run 2.csv", "run 10.csv"]
    assert group(found).names == ("1",)
    assert "3 parts, run 1.csv to run 10.csv, whose rows are counted one after" in found.notes[0]
    assert found.name == str(path)


def test_files_that_each_count_from_0_are_runs(tmp_path):
    folder = parts(
        tmp_path / "logs", change=lambda part, _: part.assign(**{"t [s]": TIME[: len(part)]})
    )
    found = read_measured(folder)
    assert len(found.table) == ROWS
    assert [*group(found).run] == [*np.repeat([0, 1, 2], ROWS // 3)]


def test_files_without_a_time_are_runs(tmp_path):
    folder = parts(tmp_path / "logs", change=lambda part, _: part.drop(columns="t [s]"))
    found = group(read_measured(folder))
    assert found.names == ("run 1.csv", "run 2.csv", "run 10.csv")
    assert [*found.run] == [*np.repeat([0, 1, 2], ROWS // 3)]


def test_runs_that_each_file_counts_anew_are_told_apart(tmp_path):
    def counted(part, place):
        run = np.repeat([1, 2 + place, 0], [ROWS // 6, ROWS // 6 - 1, 1]).astype(str)
        run[-1] = ""  # whose run is not named
        return part.assign(run=run, **{"t [s]": TIME[: len(part)]})

    found = read_measured(parts(tmp_path / "logs", change=counted))
    names = "run 1.csv:1", "2", "run 2.csv:1", "3", "run 10.csv:1", "4"
    assert group(found).names == names
    assert np.bincount(group(found).run).tolist() == 3 * [ROWS // 6, ROWS // 6 - 1]
    assert not any("clock" in note for note in found.notes)


def test_a_run_whose_time_goes_on_in_the_next_file_is_one(tmp_path):
    """Twelve runs of 20 rows, in files that end amid the fourth and the eighth."""

    def named(part, _):
        return part.assign(run=part.index // 21)

    found = group(read_measured(parts(tmp_path / "logs", change=named)))
    assert found.names == tuple(map(str, range(12)))
    np.testing.assert_array_equal(found.run, np.arange(ROWS) // 21)

    def at_once(part, place):  # axles one below the other, in each file
        whole = [named(part, place).assign(axle=axle) for axle in (1, 2)]
        return pd.concat(whole)

    found = read_measured(parts(tmp_path / "axles", change=at_once))
    assert {*found.table["run"]} == {*map(str, range(12))}

    def later(part, place):  # an hour between the files, without a time in the middle
        return named(part, place).assign(**{"t [s]": part["t [s]"] + 3600 * place})

    found = group(read_measured(parts(tmp_path / "later", change=later)))
    assert "run 1.csv:3" in found.names
    assert "run 2.csv:3" in found.names
    assert len(found.names) == 14


def test_columns_of_one_order_or_another(tmp_path):
    def turned(part, place):
        return part[part.columns[::-1]] if place else part

    found = read_measured(parts(tmp_path / "logs", change=turned))
    np.testing.assert_allclose(found.table["slip_ratio"], SLIP, atol=1e-12)


def renamed(part, place):
    return part.rename(columns={"mu": "mue"}) if place == 1 else part


def test_columns_that_do_not_agree_are_refused_in_a_sentence(tmp_path):
    folder = parts(tmp_path / "logs", change=renamed)
    with pytest.raises(InputError) as refused:
        read_measured(folder)
    assert str(refused.value) == (
        f"{folder} is not one log: the columns of {folder / 'run 1.csv'} and "
        f"{folder / 'run 2.csv'} do not agree (one of them alone has mu and mue); name files of "
        "the same columns."
    )
    marks = parts(tmp_path / "marks")
    LOG.to_csv(marks / "run 3.csv", index=False, decimal=",", sep=";")
    with pytest.raises(InputError, match="one has decimal points and the other decimal commas"):
        read_measured(marks)


def test_an_order_of_day_and_month_that_one_file_shows_is_that_of_all(tmp_path):
    """Three days, of which the last alone is no month."""

    def dated(days):
        def change(part, place):
            seconds = pd.to_timedelta(TIME[: len(part)], unit="s").total_seconds()
            stamps = [f"{days[place]} 08:00:{at:06.3f}" for at in seconds]
            return part.drop(columns="t [s]").assign(Zeit=stamps)

        return change

    days = "11/04/2026", "12/04/2026", "13/04/2026"
    found = read_measured(parts(tmp_path / "logs", change=dated(days)))
    each = TIME[: ROWS // 3]
    np.testing.assert_allclose(found.table["time_s"], [*each, *(86400 + each), *(172800 + each)])
    apart = parts(tmp_path / "apart", change=dated(("04/13/2026", *days[1:])))
    with pytest.raises(InputError, match="they write dates in different forms"):
        read_measured(apart)


def test_what_excel_puts_beside_an_open_workbook_is_no_log(tmp_path):
    folder = parts(tmp_path / "logs")
    (folder / "~$run 4.xlsx").write_bytes(b"x" * 165)
    assert len(read_measured(folder).table) == ROWS


def test_a_folder_or_a_pattern_without_a_file_is_refused(tmp_path):
    (tmp_path / "notes.md").write_text("x")
    for path in (tmp_path, tmp_path / "*.csv"):
        with pytest.raises(InputError, match=r"has no file that can be read; name a file"):
            read_measured(path)


def test_the_command_line_says_what_is_said_elsewhere():
    assert reading.WANTED == WANTED


@pytest.mark.long
def test_the_files_of_a_folder_are_compared(tmp_path):
    def wetter(part, place):
        return part.assign(mu=(0.5 if place == 2 else 1.0) * part["mu"])

    found = aj.identify(parts(tmp_path / "logs", change=wetter), "kiencke", by="file")
    table = found.comparison.table.set_index("file")
    assert found.comparison.changed
    assert table.loc["run 10.csv", "mu_max"] < 0.7 * table.loc["run 1.csv", "mu_max"]
