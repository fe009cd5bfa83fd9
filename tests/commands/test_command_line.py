"""The console command, and what it answers without importing jax."""

import os
import shlex
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from adhesion_jax import keeping
from adhesion_jax.command_line import catalogue as catalogue_module
from adhesion_jax.command_line.catalogue import catalogue, told
from adhesion_jax.command_line.program import COMMANDS, adhesion

HOME = Path(__file__).parents[2]

#: Runs the console command and says whether jax was imported on the way.
SPY = """
import sys
from adhesion_jax.command_line.program import main
try:
    main()
finally:
    print("JAX" if "jax" in sys.modules else "none", file=sys.stderr)
"""


def answered(*arguments, script=SPY, **environment):
    return subprocess.run(
        [sys.executable, "-c", script, *map(str, arguments)],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )


def test_the_modules_of_the_commands_and_what_is_said_of_them_are_those_of_the_package():
    assert set(COMMANDS) < {path.stem for path in (keeping._PACKAGE / "command_line").glob("*.py")}
    told = CliRunner().invoke(adhesion, []).output
    assert all(name in told for name in COMMANDS)
    assert CliRunner().invoke(adhesion, ["--version"]).output.split()[-1] == version("adhesion-jax")


@pytest.mark.long
def test_the_catalogue_is_that_of_the_registries():
    """In a process of its own: other tests put parts of their own into the registries."""
    script = (
        "from adhesion_jax.command_line import catalogue\n"
        "assert catalogue.catalogue() == catalogue.told()"
    )
    assert answered(script=script).returncode == 0


@pytest.mark.long
def test_the_first_command_after_a_change_has_the_flags_of_the_others(tmp_path):
    """Jax reads them when it opens a device, as the rooms do that the catalogue is asked of."""
    script = """
import os
from jax._src import xla_bridge
from adhesion_jax import runtime
opens, seen = xla_bridge._init_backend, []
def noted(platform):
    seen.append(os.environ.get("XLA_FLAGS", ""))
    return opens(platform)
xla_bridge._init_backend = noted
import adhesion_jax.command_line.identify
assert seen and all(name in flags for flags in seen for name in runtime._FLAGS), seen
"""
    found = answered(script=script, XLA_FLAGS="", ADHESION_JAX_CACHE=str(tmp_path / "empty"))
    assert found.returncode == 0, found.stderr


@pytest.mark.parametrize("name", COMMANDS)
def test_help_ends_with_examples_whose_options_there_are(name):
    command = adhesion.get_command(click.Context(adhesion), name)
    told = CliRunner().invoke(adhesion, [name, "--help"]).output
    lines = told.split("Examples:\n")[1].splitlines()
    assert lines
    for line in lines:
        program, of, *words = shlex.split(line)
        assert (program, of) == ("adhesion", name)
        command.make_context(name, words, resilient_parsing=True)


@pytest.mark.parametrize("name", [name for name in COMMANDS if name not in ("status", "rerun")])
def test_the_names_that_options_take_are_listed(name):
    listed = CliRunner().invoke(adhesion, [name, "--list"])
    assert listed.exit_code == 0
    names = {line.split()[0] for line in listed.output.splitlines() if line.startswith("  ")}
    assert len(names) > 2


def test_help_and_lists_import_no_jax():
    catalogue()  # the first command after a change of the source asks the rooms
    for arguments in ([], ["--help"], ["--version"], ["montecarlo", "--list"]):
        done = answered(*arguments)
        assert (done.returncode, done.stderr) == (0, "none\n"), arguments
        assert done.stdout
    for name in COMMANDS:
        done = answered(name, "--help")
        assert (done.returncode, done.stderr) == (0, "none\n"), name
        assert ("FOLDER" if name == "status" else "--out") in done.stdout


REFUSED = {
    "command": (["nonsense"], "nonsense is no command; name montecarlo"),
    "option": (["identify", "eurosprinter", "--depth", "3"], "--depth"),
    "identifier": (["montecarlo", "--identifiers", "ml-exact,magic"], "--identifiers magic is not"),
    "scenario": (["montecarlo", "--scenario", "moon"], "--scenario moon is not known"),
    "rail": (["montecarlo", "--scenario", "single", "--rail", "icy"], "--rail icy is not known"),
    "range": (["montecarlo", "--sigma", "11"], "--sigma"),
    "blocks": (
        ["montecarlo", "--scenario", "single", "--blocks", "3"],
        "does not go with",
    ),
    "method": (
        ["montecarlo", "--scenario", "single", "--identifiers", "ml-exact,riv"],
        "riv cannot be run on single: ",
    ),
    "curve": (["identify", "eurosprinter", "--curve", "pacejka"], "--curve pacejka is not known"),
    "curve twice": (
        ["identify", "eurosprinter", "--curve", "kiencke", "--curve", "burckhardt"],
        "--curve is given more than once; divide its values by commas",
    ),
    "both": (["identify", "eurosprinter", "--events", "--whole"], "--events is given more than"),
    "file": (["identify", "nowhere.csv"], "nowhere.csv does not exist"),
    "address": (["identify", "https://a.org/log.csv"], "is an address; download the file and"),
    "log": (["track", "nowhere.csv"], "nowhere.csv does not exist"),
    "slope": (["track", "eurosprinter", "--initial-slope", "0"], "--initial-slope"),
    "batch": (
        ["track", "eurosprinter", "--identifiers", "riv,ml-exact"],
        "--identifiers ml-exact cannot follow a log: it takes whole blocks",
    ),
    "follower": (["track", "eurosprinter", "--identifiers", "x"], "--identifiers x is not known"),
    "runs": (["discover", "nowhere.csv"], "nowhere.csv does not exist"),
    "base": (["discover", "eurosprinter", "--curve", "x"], "--curve x is not known"),
    "effect": (["discover", "eurosprinter", "--effects", "x"], "--effects x is not known"),
    "neither": (["discover"], "Missing argument 'TRAIN...'"),
    "system": (["traction", "--system", "tgv"], "--system tgv is not known"),
    "plant": (["traction", "--system", "hxd1f", "--plant", "no.toml"], "no.toml does not exist"),
    "seeker": (["traction", "--system", "hxd1f", "--seeker", "x"], "--seeker x is not known"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_refusal_is_one_sentence_and_imports_no_jax(case):
    catalogue()
    arguments, words = REFUSED[case]
    done = answered(*arguments)
    assert done.returncode == 2
    assert done.stdout == ""
    sentence, jax = done.stderr.splitlines()
    assert sentence.startswith("error: ")
    assert words in sentence
    assert jax == "none"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no device that is full")
@pytest.mark.parametrize(
    ("streams", "code", "says"),
    [
        ("> /dev/full", 1, "error: the output cannot be written (No space left on device).\n"),
        pytest.param(">&-", 0, "", marks=pytest.mark.long),
        pytest.param("2>&-", 0, "", marks=pytest.mark.long),
        pytest.param(">&- 2>&- <&-", 0, "", marks=pytest.mark.long),
    ],
)
def test_streams_that_are_full_or_closed(streams, code, says, tmp_path):
    command = (
        f"{sys.executable} -m adhesion_jax simulate --hours 0.2 --events 1 --out log.csv {streams}"
    )
    done = subprocess.run(
        command,
        shell=True,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(HOME)},
        stderr=subprocess.PIPE,
        text=True,
        timeout=120,
        check=False,
    )
    assert (done.returncode, done.stderr) == (code, says)
    assert (tmp_path / "log.csv").stat().st_size > 1000


@pytest.mark.slow
@pytest.mark.parametrize(
    "setting", ["JAX_DISABLE_JIT=1", "JAX_TRANSFER_GUARD=disallow", "MPLBACKEND=bogus"]
)
def test_settings_of_another_program_stop_no_command(setting, tmp_path):
    name, value = setting.split("=")
    command = "identify eurosprinter --curve kiencke --out out"
    done = subprocess.run(
        [sys.executable, "-m", "adhesion_jax", *command.split()],
        cwd=tmp_path,
        env={**os.environ, name: value, "PYTHONPATH": str(HOME)},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_a_file_in_the_place_of_a_folder_is_refused_before_any_work(tmp_path):
    (tmp_path / "file").write_text("")
    done = answered("montecarlo", "--out", tmp_path / "file" / "out")
    assert done.returncode == 2
    assert "cannot be written to" in done.stderr
    assert done.stderr.endswith("none\n")


def test_the_console_command_and_the_modules_answer_alike():
    asked = ["montecarlo", "--scenario", "moon"]
    script = "from runpy import run_module; run_module({!r}, run_name='__main__')"
    as_module = answered(*asked, script=script.format("adhesion_jax"))
    in_a_clone = answered(*asked[1:], script=script.format("experiments.montecarlo"))
    console = answered(*asked)
    assert as_module.returncode == in_a_clone.returncode == console.returncode == 2
    assert as_module.stderr == in_a_clone.stderr == console.stderr.replace("none\n", "")


def test_names_are_completed():
    def completed(words, place):
        done = answered(
            _ADHESION_COMPLETE="bash_complete",
            COMP_WORDS=words,
            COMP_CWORD=str(place),
            script="import sys; sys.argv[0] = 'adhesion'\n" + SPY,
        )
        return [line.split(",", 1)[1] for line in done.stdout.splitlines()]

    assert completed("adhesion id", 1) == ["identify"]
    assert completed("adhesion montecarlo --scenario he", 3) == ["he2018-1", "he2018-blocks"]
    assert completed("adhesion montecarlo --identifiers riv,ml-p", 3) == ["riv,ml-pooled"]


@pytest.mark.long
def test_a_remembered_catalogue_is_read_and_a_damaged_one_made_anew(tmp_path, monkeypatch):
    monkeypatch.setattr(keeping, "_folder", [tmp_path])
    asked = []
    monkeypatch.setattr(catalogue_module, "told", lambda: asked.append(1) or told())

    def found():
        catalogue_module.catalogue.cache_clear()
        return catalogue_module.catalogue()

    first = found()
    assert found() == first
    assert len(asked) == 1
    (file,) = tmp_path.glob("*.names")
    file.write_bytes(file.read_bytes()[:-5])
    assert found() == first
    assert len(asked) == 2
    for number in range(20):
        (tmp_path / f"{number}.names").write_text("")
    file.unlink()
    found()
    assert file.exists()
    assert len([*tmp_path.glob("*.names")]) == 9
