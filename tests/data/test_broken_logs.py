"""Forty logs that are broken or odd: each is read, or refused in one sentence that says where."""

import gzip
from typing import NamedTuple

import numpy as np
import pandas as pd
import pytest

from adhesion_jax.data import read_measured
from adhesion_jax.errors import InputError


def log(rows=60):
    """A sweep as a logger writes it: km/h, kN, and the slip in per cent."""
    slip = np.linspace(0.2, 12, rows)
    return pd.DataFrame(
        {
            "t [s]": 0.01 * np.arange(rows),
            "v [km/h]": 36.0,
            "slip [%]": slip,
            "F [kN]": (200 * 0.3 * slip / (2 + slip)).round(4),
        }
    )


#: What a user says of such a log.
SAID = {"axle_force": "F [kN]", "axle_load": "200 kN"}


class Case(NamedTuple):
    content: str | bytes
    says: tuple[str, ...] = ()  # what the refusal says; without it the log is read
    rows: int = 60  # that are used
    columns: dict = SAID
    name: str = "log.csv"
    notes: str = ""  # what one of the notes says


def text(table, **how):
    return table.to_csv(index=False, **how)


def changed(column, row, value):
    """The log with another cell in a row, by the number that a user sees."""
    table = log().astype(object)
    table.loc[row - 2, column] = value
    return text(table)


def lines(change):
    """The log with its lines changed in place."""
    found = text(log()).splitlines()
    change(found)
    return "\n".join(found) + "\n"


def german(table):
    return text(table.round(4), sep=";", decimal=",")


def wide():
    noise = np.random.default_rng(0).normal(size=(60, 300)).round(4)
    return text(pd.concat([log(), pd.DataFrame(noise).add_prefix("channel_")], axis=1))


def many_parts(table, replaced):
    """Semicolons in every row but one of commas."""
    rows = text(table, sep=";").splitlines()
    rows[replaced - 1] = rows[replaced - 1].replace(";", ",")
    return "\n".join(rows)


CASES = {
    # The header and the columns.
    "unknown unit": Case(
        text(log().rename(columns={"v [km/h]": "v [kmm/h]", "slip [%]": "dv [m/s]"})),
        rows=60,
        notes="in which unit the vehicle speed in column v [kmm/h] is",
    ),
    "unknown unit of what is needed": Case(
        text(log().rename(columns={"slip [%]": "slip [prc]"})),
        ("log.csv", "slip [prc]", "ratio or in per cent"),
    ),
    "unknown unit said": Case(
        text(log()),
        ("The unit furlong/h2x of column F [kN]",),
        columns={"axle_force": "F [kN] [furlong/h2x]"},
    ),
    "unit of another kind": Case(
        text(log()),
        ("The unit kN of column v [km/h] is no unit of",),
        columns={"speed": "v [km/h] [kN]"},
    ),
    "mapping to a column that is not there": Case(
        text(log()),
        ("log.csv has no column Kraft", "there are t [s]"),
        columns={"axle_force": "Kraft"},
    ),
    "mapping of no quantity": Case(
        text(log()), ("sped is no quantity", "speed"), columns={"sped": "v [km/h]"}
    ),
    "mapping of one column twice": Case(
        text(log()),
        ("F [kN] is said to be axle_force_N and tangential_force_N",),
        columns={"axle_force": "F [kN]", "wheel_force": "F [kN]"},
    ),
    "load of no body": Case(
        text(log()),
        ("load does not tell of which body", "wheel_load, axle_load or locomotive_load"),
        columns={"axle_force": "F [kN]", "load": "200 kN"},
    ),
    "constant without a unit": Case(
        text(log()), ("axle_load_N = 200 needs its unit",), columns={"axle_load": 200}
    ),
    "constant that cannot be": Case(
        text(log()),
        ("axle_load_N = -200000 N lies outside 1e-09 and more N",),
        columns={"axle_load": "-200 kN"},
    ),
    "force of no body": Case(
        text(log()),
        ("log.csv", "whether column F [kN] is the wheel force, axle force or locomotive force"),
        columns={},
    ),
    "load of the locomotive and force of an axle": Case(
        text(log()),
        ("log.csv", "only by the number of driven axles", '--column "driven_axles=4"'),
        columns={"axle_force": "F [kN]", "locomotive_load": "800 kN"},
    ),
    "load of the locomotive and number of axles": Case(
        text(log()),
        columns={"axle_force": "F [kN]", "locomotive_load": "800 kN", "driven_axles": 4},
    ),
    "slip without a unit": Case(
        text(log().rename(columns={"slip [%]": "Schlupf"})),
        ("log.csv", "whether the slip in column Schlupf is a ratio or in per cent"),
    ),
    "two headers": Case(
        lines(lambda rows: rows.insert(1, "time,speed,creep,force")),
        ("log.csv has two headers, in rows 1 and 2",),
    ),
    "the header again within": Case(
        lines(lambda rows: rows.insert(30, rows[0])), notes="not used: row 31 is the header again"
    ),
    "no header": Case(lines(lambda rows: rows.pop(0)), ("log.csv has numbers in row 1",)),
    "a column twice": Case(
        text(log()).replace("v [km/h]", "t [s]", 1), ("log.csv has the column t [s] twice",)
    ),
    "a line of the logger above the header": Case(
        "Logger 3000\n" + text(log()), notes="names of columns in row 2"
    ),
    "a line above numbers without a header": Case(
        "Logger 3000\n" + "\n".join(text(log()).splitlines()[1:]),
        ("log.csv has 4 cells in row 2 where its header has 1;", "lines above the header"),
    ),
    # Separators and rows.
    "half a file": Case(
        text(log())[:-12], ("log.csv has 3 cells in row 61 where its header has 4", "cut off")
    ),
    "too many cells": Case(
        lines(lambda rows: rows.__setitem__(40, rows[40] + ",7")),
        ("log.csv has 5 cells in row 41 where its header has 4",),
    ),
    "mixed separators": Case(
        many_parts(log(), 20),
        ("log.csv", "row 20", "separated by commas and those of the header by semicolons"),
    ),
    "decimal commas between commas": Case(
        text(log()).replace(".", ","), ("log.csv has ", "cells in row 2", "decimal comma")
    ),
    "blank rows within and at the end": Case(
        lines(lambda rows: rows.insert(30, "")) + "\n\n", rows=60, notes="Not used is 1 row of 61"
    ),
    "semicolons and decimal commas": Case(german(log()), notes="semicolons, decimal commas"),
    "tabs": Case(text(log(), sep="\t"), name="log.txt", notes="tabs"),
    "quoted numbers": Case(text(log().astype(str), quoting=1)),
    "a quotation mark that is not closed": Case(
        lines(lambda rows: rows.__setitem__(8, '"' + rows[8])), ("log.csv", "from row 9 on")
    ),
    "sep=;": Case("sep=;\n" + german(log())),
    # Characters.
    "UTF-16": Case(german(log()).encode("utf-16"), notes="utf-16"),
    "UTF-16 without a mark": Case(german(log()).encode("utf-16-be"), notes="utf-16-be"),
    "UTF-16 that is cut off": Case(
        german(log()).encode("utf-16")[:-1], ("log.csv ends within a character of utf-16",)
    ),
    "cp1252": Case(
        text(log().assign(**{"Temp. [°C]": 20.0, "Ort": "Süd"})).encode("cp1252"), notes="cp1252"
    ),
    "binary": Case(bytes(range(256)) * 50, ("log.csv is a binary file",)),
    "half a gz": Case(
        gzip.compress(wide().encode())[:-9],
        ("log.csv.gz is not a whole gzip file",),
        name="log.csv.gz",
    ),
    # Times.
    "time that jumps back": Case(
        changed("t [s]", 30, 0.01), rows=59, notes="the clock steps back, until it shows again"
    ),
    "two stamps alike": Case(changed("t [s]", 30, 0.27)),
    "time of 1e15 s": Case(
        text(log().assign(**{"t [s]": 1e15 + np.arange(60.0)})),
        ("log.csv", "row 2 of column t [s] has 1e+15 s, outside -1e+10 to 1e+10 s", "milliseconds"),
    ),
    "days and months that could be either": Case(
        text(log().assign(**{"t [s]": "03/04/2026 08:00:00"})),
        ("log.csv", "whether the dates in column t [s] are", '"time=t [s] [day/month/year]"'),
    ),
    # Values.
    "a thousand or one and a bit": Case(
        text(pd.DataFrame({"slip [%]": range(60), "F [kN]": "1,234"}), sep=";"),
        ("log.csv", "row 2 of column F [kN] has 1,234, which may be 1.234 or 1234"),
    ),
    "slip in per cent that is none": Case(
        text(log().rename(columns={"slip [%]": "slip_ratio"})),
        ("log.csv", "a tenth of the slips of column slip_ratio exceed 1.5", "per cent"),
    ),
    "wheel in km/h and train in m/s": Case(
        text(log().assign(v_Rad=37.0, v=10.0).drop(columns="slip [%]")),
        ("log.csv", "the wheel is 3.7 times as fast as the train", "km/h were taken for m/s"),
        columns={**SAID, "wheel_speed": "v_Rad [m/s]", "vehicle_speed": "v [m/s]"},
    ),
    "always at rest": Case(
        text(log().assign(**{"v [km/h]": 0.0, "v_Rad [km/h]": 0.2}).drop(columns="slip [%]")),
        ("log.csv", "where the slip is mostly noise, in every row (check the unit and the sign"),
    ),
    "one point": Case(text(log(1)), rows=1),
    "no point": Case(text(log()[:0]), ("log.csv", "there is a header but no point")),
    "infinite": Case(
        changed("F [kN]", 7, "inf"), rows=59, notes="infinite and not used: row 7 of column F [kN]"
    ),
    "300 columns": Case(wide()),
    "a covariate that is huge": Case(
        text(log().assign(gain=1e300)), notes="The column gain is left out: its largest value"
    ),
    "a name of 300 characters": Case("", ("cannot be read (File name too long)",), name=300 * "n"),
    "an ending that is not known": Case("x", ("the ending of", "is not known"), name="log.json"),
}


def test_there_are_at_least_forty():
    assert len(CASES) >= 40


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("case", CASES)
def test_a_log_is_read_or_refused_in_one_sentence(case, tmp_path):
    content, says, rows, columns, name, notes = CASES[case]
    path = tmp_path / name
    if content:
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    if not says:
        measured = read_measured(path, columns)
        assert len(measured.table) == rows
        np.testing.assert_allclose(
            measured.table["adhesion"].iloc[-1], 0.3 * 12 / 14 if rows > 1 else 0.3 / 11, atol=1e-4
        )
        assert notes in " ".join(measured.notes)
        return
    with pytest.raises(InputError) as refused:
        read_measured(path, columns)
    sentence = str(refused.value)
    assert "\n" not in sentence
    assert sentence.endswith(".")
    for words in says:
        assert words in sentence
