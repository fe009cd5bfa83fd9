"""What the commands that judge the package have in common."""

import io
import sys
from importlib import import_module
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from adhesion_jax import runtime
from adhesion_jax.errors import InputError
from experiments.claims.claim import Paper
from experiments.regression.table import read_baseline

FOLDERS = (Path(__file__).parents[2] / "experiments").glob("*/__main__.py")
COMMANDS = {
    path.parent.name: import_module(f"experiments.{path.parent.name}.__main__").main
    for path in sorted(FOLDERS)
}
COMMANDS |= {name: import_module(f"experiments.{name}").main for name in ("rules", "strangers")}

every_command = pytest.mark.parametrize("command", COMMANDS.values(), ids=COMMANDS)


@every_command
def test_help_says_what_is_done_and_where_it_is_written(command):
    told = CliRunner().invoke(command, ["--help"])
    assert told.exit_code == 0
    assert "--out" in told.output
    assert command.help.split("\n")[0].endswith(".")


@every_command
@pytest.mark.parametrize(("out", "words"), [("", "name is empty"), ("file/out", "cannot be")])
def test_a_folder_that_cannot_be_is_refused_and_nothing_is_written(
    command, out, words, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    Path("file").write_text("")
    with pytest.raises((InputError, click.ClickException), match=words):
        command.main(["--out", out], standalone_mode=False)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


REFUSED = {
    "no sets": ("discovery_study", [*("--null", "0", "--powers", "0"), "--random=0", "--pairs=0"]),
    "There is no set to work on": ("discovery_peers", ["--simulated", "0"]),
    "--methods x is not known": ("discovery_peers", ["--methods", "x"]),
    "no.csv does not exist": ("regression", ["--baseline", "no.csv"]),
    "--runs": ("claims", ["--runs", "1"]),
    "--repeats": ("speed", ["--repeats", "0"]),
}


@pytest.mark.parametrize("words", REFUSED)
def test_a_refusal_says_what_is_wrong(words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    name, arguments = REFUSED[words]
    with pytest.raises((InputError, click.ClickException)) as refused:
        COMMANDS[name].main(arguments, standalone_mode=False)
    error = refused.value
    said = error.format_message() if isinstance(error, click.ClickException) else str(error)
    assert words in said
    assert not list(tmp_path.iterdir())


class Full(io.StringIO):
    def write(self, _):
        raise OSError(28, "No space left on device")


@pytest.mark.parametrize(
    ("name", "arguments", "files"),
    [
        ("claims", ["--out", "out"], {"out/claims.csv"}),
        ("regression", ["--out", "out"], {"out/regression.csv", "out/comparison.csv"}),
        ("regression", ["--update", "--baseline", "mine.csv"], {"mine.csv"}),
    ],
)
def test_files_are_there_whether_or_not_what_is_told_can_be_printed(
    name, arguments, files, tmp_path, monkeypatch
):
    where = f"experiments.{name}.__main__"
    if name == "claims":
        row = Paper("One", {"one": {"claim": "C", "remark": "R."}}).judged("one")
        monkeypatch.setattr(f"{where}.PAPERS", {"one": lambda _: [row]})
    else:
        table = read_baseline(Path(__file__).parents[2] / "results" / "baseline.csv")
        monkeypatch.setattr(f"{where}._measured", lambda *_: table)
        monkeypatch.setattr(f"{where}.read_baseline", lambda _: table)
        monkeypatch.setattr(runtime, "take_core", lambda _: None)
    monkeypatch.chdir(tmp_path)
    with monkeypatch.context() as patched:
        patched.setattr(sys, "stdout", Full())
        with pytest.raises(OSError, match="No space left"):
            COMMANDS[name].main(arguments, standalone_mode=False)
    assert {path.as_posix() for path in map(Path, files) if path.is_file()} == files
    said = CliRunner().invoke(COMMANDS[name], arguments).output.strip().splitlines()
    assert said[-1].startswith("Written to ")
    assert len(said) > 1
    assert "--update" not in arguments or said[0] == "The baseline is now mine.csv"
