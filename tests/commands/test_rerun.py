"""Results repeat from their folder: metadata.json, and the command that reads it."""

import json
import shlex
from contextlib import chdir

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

import adhesion_jax as aj
from adhesion_jax.command_line.program import adhesion
from adhesion_jax.errors import InputError

FRAME = pd.read_csv(aj.SHIPPED["eurosprinter"].path)

#: A small call of each command; LOG is a file in the folder where it is run.
CALLS = {
    "identify": ["LOG", "--curve", "kiencke", "--column", "speed=v [km/h]"],
    "track": ["LOG", "--identifiers", "rls-kiencke", "--column", "speed=v [km/h]"],
    "plan": ["--rail", "common", "--largest-slips", "0.1:0.4:3", "--samples", "100:1000:2"],
    "simulate": ["--hours", "0.01", "--events", "0", "--out", "first/log.csv"],
    "montecarlo": ["--scenario", "single", "--runs", "130", "--identifiers", "ml-exact"],
    "discover": ["roller-rig", "--curve=auto"],
}

LONG = ("identify", "track", "montecarlo", "discover")


def ran(*arguments):
    done = CliRunner().invoke(adhesion, [*map(str, arguments)], catch_exceptions=False)
    assert done.exit_code == 0
    return done.output


def tables(folder):
    """What does not depend on the clock."""
    clocks = ("metadata.json", "report.json", "track.txt")
    found = {}
    for path in sorted(folder.iterdir()):
        if path.suffix == ".csv" and path.name != "log.csv":
            table = pd.read_csv(path)
            found[path.name] = table[[name for name in table if "seconds" not in name]].to_csv()
        elif path.suffix in (".json", ".txt", ".csv") and path.name not in clocks:
            found[path.name] = path.read_bytes()
    return found


@pytest.fixture
def work(tmp_path):
    """A folder to work in, with a log; LOG stands for it."""
    named = FRAME.assign(v=3.6 * FRAME["vehicle_speed_mps"]).drop(columns="vehicle_speed_mps")
    named.rename(columns={"v": "v [km/h]"}).to_csv(tmp_path / "log.csv", index=False)
    return tmp_path


@pytest.mark.parametrize(
    "command",
    [pytest.param(one, marks=pytest.mark.long if one in LONG else ()) for one in CALLS],
)
def test_the_results_of_a_command_repeat_from_their_folder(command, work):
    arguments = ["log.csv" if one == "LOG" else one for one in CALLS[command]]
    if command != "simulate":
        arguments += ["--out", "first"]
    with chdir(work):
        ran(command, *arguments)
    told = json.loads((work / "first" / "metadata.json").read_text())
    assert (told["command"], told["arguments"]) == (command, arguments)
    assert told["folder"] == str(work)
    assert told["versions"]["adhesion-jax"]
    if "LOG" in CALLS[command]:
        assert told["options"]["--column"] == ["speed=v [km/h]"]
        (columns,) = told["columns"].values()
        row = next(one for one in columns if one["column"] == "v [km/h]")
        assert (row["taken_as"], row["unit"]) == ("vehicle_speed_mps", "km/h")
        assert row["lowest"] == pytest.approx(36.0)
    # From wherever it is called.
    said = ran("rerun", work / "first", "--out", work / "again")
    assert f"In {work}: {shlex.join(['adhesion', command, *arguments])}\n" in said
    assert "Versions have changed" not in said
    assert tables(work / "again") == tables(work / "first") != {}
    names = [{one.name for one in (work / where).iterdir()} for where in ("first", "again")]
    assert names[0] == names[1]
    # What was repeated can be repeated.
    assert json.loads((work / "again" / "metadata.json").read_text())["command"] == command


@pytest.mark.thorough
def test_of_a_job_that_was_extended_all_runs_are_repeated(work):
    of_job = ["montecarlo", "--scenario", "single", "--identifiers", "ml-exact", "--runs", "130"]
    with chdir(work):
        ran(*of_job, "--out", "first")
        ran(*of_job, "--out", "first", "--extend", "20")
    ran("rerun", work / "first", "--out", work / "again")
    assert tables(work / "again") == tables(work / "first")
    rows = [pd.read_parquet(work / where / "runs.parquet") for where in ("first", "again")]
    assert rows[0]["run"].nunique() == 150
    np.testing.assert_array_equal(rows[0]["mu_max"], rows[1]["mu_max"])


@pytest.mark.long
def test_a_version_that_has_changed_is_told(work):
    with chdir(work):
        ran("plan", *CALLS["plan"], "--out", "first")
    path = work / "first" / "metadata.json"
    told = json.loads(path.read_text())
    now = told["versions"]["numpy"]
    told["versions"] |= {"numpy": "1.0", "nowhere": "2.0"}
    path.write_text(json.dumps(told))
    said = ran("rerun", work / "first", "--out", work / "again")
    assert f"Versions have changed since: numpy 1.0 to {now}, nowhere 2.0 to none." in said


WHOLE = {"command": "plan", "arguments": [], "folder": ".", "options": {}, "versions": {}}


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (None, "cannot be read"),
        ("", "does not say by which command"),
        ("[]", "does not say by which command"),
        ("[" * 10_000, "does not say by which command"),
        (json.dumps(WHOLE | {"command": "status"}), "does not say by which command"),
        (json.dumps(WHOLE | {"options": None}), "does not say by which command"),
        (json.dumps(WHOLE | {"arguments": [1]}), "does not say by which command"),
        (json.dumps(WHOLE | {"command": "simulate"}), "does not say by which command"),
        (json.dumps(WHOLE | {"options": {"--extend": 1}}), "does not say by which command"),
        (json.dumps(WHOLE | {"versions": {"": 1}}), "does not say by which command"),
        (json.dumps({"call": {}}), "a program of yours has asked for; run it again"),
        (json.dumps(WHOLE | {"folder": "/nowhere"}), "the folder /nowhere, which is not there"),
        (json.dumps(WHOLE | {"folder": "\0"}), "which is not there"),
        (json.dumps(WHOLE), "Name one of LOG, --rail and --law"),
    ],
)
def test_what_cannot_be_repeated_is_refused_in_a_sentence(content, says, tmp_path):
    if content is not None:
        (tmp_path / "metadata.json").write_text(content)
    with pytest.raises(InputError, match=says):
        ran("rerun", tmp_path, "--out", tmp_path / "again")
