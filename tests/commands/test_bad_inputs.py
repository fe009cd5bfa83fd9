"""Bad files and options: every one is read, or answered in a sentence, in seconds.

The files are made from a few good ones by faults of a fixed seed; the options are written out.
"""

import gzip
import json
import os
import sys
import time

import numpy as np
import pandas as pd
import pytest
from lanes import lanes

from adhesion_jax.command_line.command import run
from adhesion_jax.command_line.program import adhesion
from adhesion_jax.data import check_curve, read_all, read_measured, to_runs
from adhesion_jax.errors import InputError

#: Files of each kind that are made, and seconds that one may take.
FILES, LONGEST_S = 150, 10.0


def good(rows=40):
    slip = np.linspace(0.002, 0.12, rows)
    return pd.DataFrame(
        {
            "t [s]": 0.05 * np.arange(rows),
            "v [km/h]": 36.0,
            "v_Rad1 [km/h]": 36 * (1 + slip),
            "v_Rad2 [km/h]": 36 * (1 + slip / 2),
            "Z_Achse1 [kN]": 60 * slip / (0.02 + slip),
            "Z_Achse2 [kN]": 60 * slip / (0.03 + slip),
            "Achslast [kN]": 200.0,
            "Temperatur [°C]": 8.5,
            "Strecke": "Süd",
        }
    )


CELLS = ["", "-", "nan", "inf", "-inf", "1e308", "-1e300", "1,5", "1.234.567", "x" * 300, '"', "0"]
CELLS += [
    "03/04/2026",
    "25:61:00",
    "\x1b[31m",
    "\u202e12",
    "=SUM(A1)",
    "1_000",
    "٣",
    "0x10",
    "#REF!",
]
NAMES = ["", "slip", "v [9**9**9]", "mu [kN]", "run", "Axle", "Mode", "time_s", "before", "error"]
NAMES += ["v_Rad1 [km/h]", "\x07bell", "n" * 400, "slip_ratio", "mu_1", "adhesion_sd", "a;b", "#"]


def faulty(draw):
    """A good table with one to four faults, as bytes."""
    table = good(int(draw.choice([0, 1, 3, 12, 40]))).astype(object)
    mark = str(draw.choice([",", ";", "\t", "|"]))
    for _ in range(draw.integers(1, 5)):
        column = draw.integers(len(table.columns))
        rows = draw.integers(0, max(len(table), 1), draw.integers(1, 12))
        match draw.integers(6):
            case 0:
                if len(table):
                    table.iloc[rows % len(table), column] = str(draw.choice(CELLS))
            case 1:
                names = [*table.columns]
                names[column] = str(draw.choice(NAMES))
                table.columns = names
            case 2:
                table = table.iloc[:, np.arange(len(table.columns)) != column]
            case 3:
                table = table.sample(frac=1.0, random_state=int(draw.integers(1000)))
            case 4:
                table = pd.concat([table, table.iloc[:, [column]]], axis=1)
            case 5:
                table = pd.concat([table, table.iloc[: len(table) // 2]])
    text = table.to_csv(index=False, sep=mark, decimal="," if mark == ";" else ".")
    if draw.random() < 0.2:
        text = "Logger 7\n\n" + text
    encoding = str(draw.choice(["utf-8", "cp1252", "utf-16", "utf-8-sig", "cp850"]))
    content = bytearray(text.encode(encoding, errors="replace"))
    for _ in range(draw.integers(0, 4) if draw.random() < 0.4 else 0):
        if content:
            content[draw.integers(len(content))] = draw.integers(256)
    return bytes(content[: draw.integers(len(content) + 1)] if draw.random() < 0.15 else content)


def answered(path, columns=None):
    """Whether a file is read; False where it is refused in a sentence."""
    begun = time.monotonic()
    try:
        found = read_measured(path, columns)
        table = found.table
        assert np.isfinite(table.select_dtypes("number").to_numpy(float)).all()
        check_curve(found)
        to_runs(read_all([path]))
        return True
    except InputError as refused:
        sentence = str(refused)
        assert sentence.endswith(".")
        assert "\n" not in sentence
        return False
    finally:
        assert time.monotonic() - begun < LONGEST_S


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("ending", lanes([".csv", ".txt", ".csv.gz", ".parquet"], always=1, long=3))
def test_files_with_faults_are_read_or_refused_in_a_sentence(ending, tmp_path):
    draw = np.random.default_rng(len(ending))
    read = 0
    for number in range(FILES):
        content = faulty(draw)
        path = tmp_path / f"{number}{ending}"
        if ending == ".csv.gz":
            content = gzip.compress(content)
        elif ending == ".parquet":
            good().to_parquet(path)
            content = bytearray(path.read_bytes())
            for _ in range(draw.integers(1, 6)):
                content[draw.integers(len(content))] = draw.integers(256)
        path.write_bytes(bytes(content))
        read += answered(path)
    assert 0 < read < FILES


def test_units_that_would_never_end_are_no_units(tmp_path):
    for bomb in ("9**9**9", "9^9^9", "9**(8+1)**9", "(9**9)**(9**9)", "m**9**9", "9" * 400):
        table = good().rename(columns={"v [km/h]": f"v [{bomb}]"})
        path = tmp_path / "a.csv"
        table.to_csv(path, index=False)
        assert not answered(path)
        assert not answered(path, {"axle_load": f"200 [{bomb}]"})


def test_names_steer_no_terminal_and_no_table(tmp_path):
    table = good().assign(**{"\x1b[31mred\x07": 1.0, "a\u202eb": 2.0, "before": 3.0, "error": 4.0})
    table = table.drop(columns=["v_Rad2 [km/h]", "Z_Achse2 [kN]"])
    table.to_csv(tmp_path / "a.csv", index=False)
    found = read_measured(tmp_path / "a.csv")
    assert {"[31mred", "ab", "before (as it is)", "error (as it is)"} <= {*found.table}


def status_of(monkeypatch, capsys, *words):
    """The status of a command, which says one sentence where it is 2."""
    monkeypatch.setattr(sys, "argv", ["adhesion", *map(str, words)])
    with pytest.raises(SystemExit) as ended:
        run(adhesion)
    said = capsys.readouterr().err
    assert said.startswith("error: ")
    assert said.count("\n") == 1, words
    return ended.value.code


def test_options_that_cannot_be_meant_are_refused(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    good().to_csv("log.csv", index=False)
    os.mkfifo("pipe")
    (tmp_path / "deep.toml").write_text("a = " + "[" * 5000 + "]" * 5000)
    (tmp_path / "deep.py").write_text("(" * 5000)
    (tmp_path / "empty").mkdir()
    said = [
        "--column",
        "speed=v",
        "--column",
        "wheel_speed=v_Rad1",
        "--column",
        "axle_force=Z_Achse1",
    ]
    for options in (
        ["identify", "log.csv", *said, "--slip-noise", "nan"],
        ["identify", "log.csv", *said, "--slip-noise", "inf"],
        ["discover", "log.csv", *said, "--slip-noise", "nan"],
        ["identify", "log.csv", *said, "--wheel-radius", "nan"],
        ["identify", "log.csv", *said, "--inertia", "inf"],
        ["identify", "log.csv", *said, "--delay", "force=inf"],
        ["identify", "log.csv", *said, "--out", "x" * 300],
        ["identify", "log.csv", *said, "--out", "/".join(["d"] * 3000)],
        ["identify", "log.csv", *said, "--out", "/".join(["d"] * 1500)],
        ["identify", "log.csv", *said, "--out", "log.csv/deep"],
        ["identify", "log.csv", *said, "--columns", "pipe"],
        ["identify", "log.csv", *said, "--columns", "deep.toml"],
        ["identify", "log.csv", *said, "--columns", "empty"],
        ["identify", "log.csv", *said, "--curve", "pipe.py:A"],
        ["identify", "log.csv", *said, "--curve", "deep.py:A"],
        ["identify", "log.csv", *said, "--column", "speed=0 m/s"],
        ["identify", "log.csv", *said, "--column", "axle_load=0 kN"],
        ["identify", "log.csv", *said, "--column", "axle_load=9**9**9"],
        ["identify", "log.csv", *said, "--column", "=v"],
        ["identify", "log.csv", "--column", "load=-Z_Achse1"],
        ["identify", "pipe"],
        ["identify", "empty"],
        ["identify", "/dev/zero"],
        ["identify", "log.csv", *said, "--curve", "kiencke", "--curve", "burckhardt"],
        ["track", "log.csv"],
        ["montecarlo", "--scenario", "single", "--runs", "9" * 20],
        ["montecarlo", "--scenario", "single", "--runs", "10", "--extend", "9" * 20],
        ["montecarlo", "--scenario", "he2018-blocks", "--blocks", "9" * 9],
        ["traction", "--system", "fang2018", "--runs", "9" * 20],
        ["plan", "--rail", "common", "--sigma", "0"],
        ["plan", "--rail", "common", "--sigma", "1e-300"],
        ["status", "log.csv"],
        ["status", "empty"],
    ):
        assert status_of(monkeypatch, capsys, *options) == 2, options
    assert sorted(one.name for one in tmp_path.iterdir() if one.is_dir()) == ["empty"]


JOB = {"name": "single", "shards": 2, "runs": 20, "depends on": {}}
RECORDS = [
    [],
    "job",
    {},
    {"command": "montecarlo"},
    {"command": 7, "jobs": []},
    {"command": "montecarlo", "jobs": [7]},
    {"command": "montecarlo", "jobs": {"a": 1}},
    *(
        {"command": "montecarlo", "jobs": [{**JOB, key: wrong}]}
        for key in ("name", "shards", "runs")
        for wrong in (None, -1)
    ),
    *(
        {"command": "montecarlo", "jobs": [{**JOB, "shards": wrong}]}
        for wrong in ("2", 10**12, 1.5)
    ),
    {"command": "montecarlo", "jobs": [{**JOB, "name": "../../etc"}]},
]


@pytest.mark.parametrize("record", RECORDS, ids=range(len(RECORDS)))
def test_the_status_of_a_job_that_was_tampered_with(record, tmp_path, monkeypatch, capsys):
    (tmp_path / "shards").mkdir()
    (tmp_path / "shards" / "job.json").write_text(json.dumps(record))
    monkeypatch.setattr(sys, "argv", ["adhesion", "status", str(tmp_path)])
    with pytest.raises(SystemExit) as ended:
        run(adhesion)
    assert ended.value.code == 2
    assert capsys.readouterr().err.startswith("error: ")
