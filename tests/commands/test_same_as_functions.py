"""A command and the function of its name: the same numbers, and the same files."""

import json
from importlib import import_module

import pandas as pd
import pytest
from click.testing import CliRunner

import adhesion_jax as aj

#: What a command records of itself, and a function of its call.
ASKED = ("command", "arguments", "folder", "options", "call")

#: What a command is given, what the function is, and what of their files depends on the clock.
ALIKE = {
    "identify": (
        ["eurosprinter", "--curve", "kiencke"],
        {"data": "eurosprinter", "curves": "kiencke"},
        {"metadata.json": ASKED},
    ),
    "track": (
        ["eurosprinter", "--identifiers", "rls-kiencke"],
        {"data": "eurosprinter", "identifiers": "rls-kiencke"},
        {"track.txt": None, "metadata.json": ASKED},  # it tells the time of a sample
    ),
    "montecarlo": (
        ["--scenario", "single", "--runs", "130", "--identifiers", "ml-exact"],
        {"scenario": "single", "identifiers": "ml-exact", "runs": 130},
        {"metadata.json": ["wall_seconds", "compile_seconds", *ASKED]},
    ),
    "discover": (
        ["roller-rig"],
        {"data": "roller-rig"},
        {"report.json": ["seconds"], "metadata.json": ASKED},
    ),
    "plan": (
        ["--rail", "common", "--want", "1%"],
        {"source": "common", "want": 0.01},
        {"metadata.json": ASKED},
    ),
}


#: Those that take some seconds are long.
MARKS = {"plan": (), "discover": pytest.mark.thorough}


def contents(folder, clocks):
    """What the files hold that programs read; pictures and pages are drawn from it."""
    found = {}
    for path in folder.iterdir():
        if path.suffix in (".json", ".txt"):
            found[path.name] = path.read_text()
        elif path.suffix == ".csv":
            table = pd.read_csv(path)
            found[path.name] = table[[name for name in table if "seconds" not in name]].to_csv()
        if clocks.get(path.name, ()) is None:
            del found[path.name]
        elif path.name in clocks:
            told = json.loads(found[path.name])
            found[path.name] = {k: v for k, v in told.items() if k not in clocks[path.name]}
    return found


@pytest.mark.parametrize(
    "name", [pytest.param(one, marks=MARKS.get(one, pytest.mark.long)) for one in ALIKE]
)
def test_a_command_and_its_function_write_the_same(name, tmp_path):
    words, arguments, clocks = ALIKE[name]
    main = import_module(f"adhesion_jax.command_line.{name}").main
    by_command, by_function = tmp_path / "command", tmp_path / "function"
    done = CliRunner().invoke(main, [*words, "--out", str(by_command)], catch_exceptions=False)
    assert done.exit_code == 0
    getattr(aj, name)(**arguments, out=by_function)
    told = json.loads((by_function / "metadata.json").read_text())
    assert told["call"]["function"] == name
    assert told["call"]["arguments"]["out"] == str(by_function)
    assert told["versions"]["adhesion-jax"]
    expected = contents(by_command, clocks)
    assert expected
    assert contents(by_function, clocks) == expected
    assert {one.name for one in by_command.iterdir()} == {one.name for one in by_function.iterdir()}
