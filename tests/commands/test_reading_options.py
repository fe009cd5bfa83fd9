"""The options by which commands are told what the columns of a log are."""

import sys

import numpy as np
import pandas as pd
import pytest

from adhesion_jax.command_line import discover, identify
from adhesion_jax.command_line.command import run

COMMANDS = {"identify": identify.main, "discover": discover.main}

SAID = ("--column", "axle_force=F [kN]", "--column", "axle_load=200 kN")


@pytest.fixture
def log(tmp_path):
    slip = np.linspace(0.2, 12, 60)
    table = pd.DataFrame({"slip [%]": slip, "F [kN]": 60 * slip / (2 + slip), "wear": slip**2})
    path = tmp_path / "log.csv"
    table.round(4).to_csv(path, index=False, sep=";", decimal=",")
    return path


def answer(command, path, monkeypatch, capsys, *options):
    """Status, and what is printed on standard output and standard error."""
    out = str(path.parent / "out")
    monkeypatch.setattr(sys, "argv", [command, str(path), *options, "--out", out])
    status = 0
    try:
        run(COMMANDS[command])
    except SystemExit as ended:
        status = ended.code
    said = capsys.readouterr()
    assert not (path.parent / "out").exists()
    return status or 0, said.out, said.err


@pytest.mark.parametrize("command", COMMANDS)
def test_a_dry_run_prints_the_table_and_stops(command, log, monkeypatch, capsys):
    status, out, err = answer(command, log, monkeypatch, capsys, *SAID, "--dry-run")
    assert (status, err) == (0, "")
    head, names, *rows = out.splitlines()
    assert head.endswith("log.csv: 60 rows are used.")
    assert names.split() == ["column", "taken", "as", "unit", "range", "missing"]
    assert any(" ".join(row.split()) == "slip [%] slip_ratio % 0.2 to 12 0 %" for row in rows)
    assert any(" ".join(row.split()) == "F [kN] axle_force_N kN 5.455 to 51.43 0 %" for row in rows)
    assert any("constant" in row and "axle_load_N" in row for row in rows)
    assert "The log has cells separated by semicolons, decimal commas." in rows


def test_a_dry_run_refuses_what_the_command_would(tmp_path, monkeypatch, capsys):
    path = tmp_path / "five.csv"
    path.write_text("slip_ratio,adhesion\n" + "".join(f"0.0{i},0.{i}\n" for i in range(1, 6)))
    said = answer("identify", path, monkeypatch, capsys, "--dry-run")
    assert said[0] == 2
    assert "five.csv: 5 rows are used." in said[1]
    assert "there are 5 points (at least 10 rows of data are needed)" in said[2]
    assert said[2] == answer("identify", path, monkeypatch, capsys)[2]


@pytest.mark.parametrize("command", COMMANDS)
def test_what_is_ambiguous_is_asked_for_in_one_sentence(command, log, monkeypatch, capsys):
    status, out, err = answer(command, log, monkeypatch, capsys)
    assert status == 2
    # What is understood so far stands above the question.
    head, *rows = out.splitlines()
    assert head == "Columns as understood so far:"
    assert any(" ".join(row.split()) == "slip [%] slip_ratio % 0.2 to 12 0 %" for row in rows)
    assert err.startswith("error: ")
    assert err.endswith(".\n")
    assert err.count("\n") == 1
    assert "whether column F [kN] is the wheel force, axle force or locomotive force" in err
    assert '--column "axle_force=F [kN]"' in err


def test_a_file_says_the_same_and_the_option_goes_before_it(log, monkeypatch, capsys):
    file = log.parent / "map.toml"
    file.write_text('axle_force = "F [kN]"\naxle_load = "100 kN"\nslip = "slip [%]"\n')
    options = ("--columns", str(file), "--column", "axle_load=200 kN", "--dry-run")
    assert answer("identify", log, monkeypatch, capsys, *options)[:2] == (
        *answer("identify", log, monkeypatch, capsys, *SAID, "--dry-run")[:2],
    )


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--column", "speed"), '--column "speed" does not say what a column is'),
        (("--column", "=v"), "QUANTITY=COLUMN [UNIT]"),
        (("--column", "speed=a", "--column", "speed=b"), "--column speed is given twice"),
        (("--column", "sped=wear"), "sped is no quantity that is known"),
        (("--column", "speed=waer [km/h]"), "has no column waer"),
        (("--column", "speed=wear [kN]"), "The unit kN of column wear is no unit of"),
        (("--columns", "nowhere.toml"), "nowhere.toml cannot be read (No such file"),
        (("--columns", "LOG"), "is not TOML"),
        (("--wheel-radius", "0"), "--wheel-radius"),
        (("--delay", "force"), '--delay "force" does not say how late a signal is'),
        (("--delay", "force=inf"), "write NAME=SECONDS"),
        (("--delay", "force=0.1", "--delay", "force=0.2"), "--delay force is given twice"),
        ((*SAID, "--delay", "force=0.1"), "because there is no time"),
        ((*SAID, "--inertia", "420"), "the inertia cannot be taken off the force, which needs"),
        (("--inertia", "0"), "--inertia"),
        (("--efficiency", "1.5"), "--efficiency"),
        (("--wheel-radius", "nan"), "is not a finite number"),
    ],
)
def test_what_cannot_be_meant_is_refused_in_one_sentence(options, says, log, monkeypatch, capsys):
    options = tuple(str(log) if option == "LOG" else option for option in options)
    status, out, err = answer("identify", log, monkeypatch, capsys, *options)
    assert (status, out) == (2, "")
    assert says in err
    assert err.count("\n") == 1
    assert "Traceback" not in err


def test_what_is_known_of_the_sensors_goes_to_the_reading(tmp_path, monkeypatch, capsys):
    time = 0.05 * np.arange(200)
    train = 10 + 0.1 * time
    torque = 20 * time
    table = pd.DataFrame({"t [s]": time, "v [m/s]": train - 0.02, "v_Rad [m/s]": 1.01 * train})
    path = tmp_path / "log.csv"
    table.assign(**{"Motormoment [Nm]": torque, "Achslast [kN]": 200}).to_csv(path, index=False)
    known = ("--wheel-radius", "0.5", "--gear-ratio", "4", "--efficiency", "0.9")
    late = ("--delay", "vehicle_speed=0.2", "--inertia", "100")
    status, out, err = answer("identify", path, monkeypatch, capsys, "--dry-run", *known, *late)
    assert (status, err) == (0, "")
    assert "log.csv: 196 rows are used." in out
    # The delay is what the offset of the speed looks like; 1 % of slip is left.
    rows = [" ".join(row.split()) for row in out.splitlines()]
    assert "computed: slip velocity / train speed slip_ratio 1 0.01 to 0.01 0 %" in rows
    assert "motor torque x 4 x 0.9 (in braking / 0.9) / 0.5 m" in out
    assert "The inertia of the wheelset, 100 kg m2 at 0.5 m" in out


@pytest.mark.parametrize("command", COMMANDS)
def test_a_name_of_300_characters_is_refused(command, tmp_path, monkeypatch, capsys):
    path = tmp_path / (300 * "n" + ".csv")
    status, out, err = answer(command, path, monkeypatch, capsys)
    assert (status, out) == (2, "")
    assert "cannot be read (File name too long)" in err
    assert err.count("\n") == 1
