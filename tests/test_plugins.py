"""Parts in files of the user's own: the page's examples by its commands, and what is refused."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

from adhesion_jax import plugins
from adhesion_jax.errors import InputError
from adhesion_jax.plugins import part, use

PAGE = Path(__file__).parents[1] / "docs" / "extending.md"
TEXT = PAGE.read_text(encoding="utf-8")
FILES = dict(re.findall(r"```python\n# (\w+\.py)\n(.*?)```", TEXT, re.DOTALL))
COMMANDS = re.findall(r"^adhesion (.*\.py:.*)$", TEXT.split("```sh\n")[1], re.MULTILINE)


def ran(command, folder, out="out"):
    done = subprocess.run(
        [sys.executable, "-m", "adhesion_jax", *command.split(), "--out", out],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(PAGE.parents[1])},
        capture_output=True,
        text=True,
        check=False,
        timeout=550,
    )
    assert "Traceback" not in done.stderr
    return done


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with the files of the page, and nothing else."""
    home = tmp_path_factory.mktemp("own")
    for name, content in FILES.items():
        (home / name).write_text(content)
    return home


def of(command, *words):
    (found,) = [one for one in COMMANDS if all(word in one for word in (command, *words))]
    return found


def done_in(folder, command, out):
    done = ran(command, folder, out)
    assert done.returncode == 0, done.stderr
    return folder / out, done.stdout


def test_the_page_shows_a_file_of_each_kind_and_a_command_for_each():
    assert len(COMMANDS) == 8
    named = {name for command in COMMANDS for name in re.findall(r"(\w+\.py):", command)}
    assert named == {*FILES}


def mu_max(out, identifier="DampedGaussNewton"):
    table = pd.read_csv(out / "summary.csv").set_index(["identifier", "quantity"])
    return table.loc[identifier, "mu_max"]


@pytest.mark.slow
def test_an_identifier_is_compared_and_one_that_was_edited_gives_new_numbers(folder):
    asked = of("montecarlo", "--identifiers damped")
    whole = mu_max(done_in(folder, asked, "damped")[0])
    assert whole["runs"] == 200  # of two tiles, so that there are worker processes
    assert whole["rmse_over_crlb"] == pytest.approx(1, abs=3.3 * whole["rmse_over_crlb_se"])
    own = folder / "damped.py"
    own.write_text(FILES["damped.py"].replace("0, 50, step", "0, 2, step"))
    hasty = mu_max(done_in(folder, asked, "hasty")[0])
    assert hasty["rmse"] > 1.5 * whole["rmse"]
    own.write_text(FILES["damped.py"])
    again = mu_max(done_in(folder, asked, "again")[0])
    assert again["rmse"] == whole["rmse"]


@pytest.mark.slow
def test_a_function_of_scipy_is_compared(folder):
    out, _ = done_in(folder, of("montecarlo", "by_scipy.py"), "scipy")
    row = mu_max(out, "least_squares")
    assert row["rmse"] == pytest.approx(mu_max(out, "ml-exact")["rmse"], rel=1e-3)
    assert row["failure_share"] == 0


@pytest.mark.slow
def test_a_class_of_numpy_is_compared(folder):
    out, told = done_in(folder, of("montecarlo", "in_numpy.py"), "numpy")
    own, ours = mu_max(out, "Recursive"), mu_max(out, "rls-kiencke")
    assert own["rmse"] == pytest.approx(ours["rmse"], rel=1e-3)
    assert "Slow, because it is called in Python: Recursive" in told


@pytest.mark.thorough
def test_a_scenario_has_options_of_its_own(folder):
    out, told = done_in(folder, of("montecarlo", "steep.py"), "steep")
    assert "of steep" in told
    table = pd.read_csv(out / "summary.csv").set_index("quantity")
    assert table.loc["c2", "truth"] == 80
    assert set(table["scenario"]) == {"steep"}
    assert (table["rail"] == "steep").all()


@pytest.mark.thorough
def test_the_options_of_a_scenario_are_in_its_help_and_in_their_range(folder):
    asked = "montecarlo --scenario steep.py:steep"
    assert "Steepness of the rise, c2." in " ".join(ran(f"{asked} --help", folder).stdout.split())
    refused = ran(f"{asked} --steepness 151", folder)
    assert refused.returncode == 2
    assert "20<=x<=150" in refused.stderr
    refused = ran(f"{asked} --points 100", folder)
    assert "--points does not go with --scenario steep" in refused.stderr


@pytest.mark.long
def test_a_curve_is_identified(folder):
    out, told = done_in(folder, of("identify"), "curve")
    assert "Weights of the curves" in told
    table = pd.read_csv(out / "curves.csv").set_index("curve")
    assert {*table.index} == {"Hyperbolic", "kiencke"}
    assert 0.25 < table.loc["Hyperbolic", "mu_max"] < 0.35


@pytest.mark.slow
def test_a_seeker_drives(folder):
    out, _ = done_in(folder, of("traction"), "seeker")
    metrics = pd.read_csv(out / "metrics.csv")
    assert set(metrics["method"]) == {"seeker Cautious"}
    assert metrics["utilisation"].between(0.3, 1).all()


@pytest.mark.slow
def test_an_effect_is_found(folder, monkeypatch):
    monkeypatch.chdir(folder)
    exec(re.search(r"```python\n(import numpy.*?leafy.csv.*?)```", TEXT, re.DOTALL)[1], {})
    out, told = done_in(folder, of("discover", "--effects"), "effect")
    assert "eaves on the rail" in told
    (leaves,) = json.loads((out / "report.json").read_text())["effects"]
    assert leaves["parameters"]["k"]["low"] < 0.25 < leaves["parameters"]["k"]["high"]


@pytest.mark.slow
def test_a_curve_is_the_base_of_a_search(folder):
    out, _ = done_in(folder, of("discover", "--curve"), "base")
    assert "Hyperbolic" in (out / "report.md").read_text()


# ----------------------------------------------------------------------------- what is refused

HEAD = """
from typing import ClassVar
from adhesion_jax.identifiers import Identifier
from adhesion_jax.curves import Curve
"""
BROKEN = {
    "no file": (None, "X", "cannot be read (No such file or directory)"),
    "no name": ("x = 1", "", "name the part in it too, as"),
    "no Python": ("x = 1\ndef y(:\n", "X", "is no Python in line 2"),
    "no text": ("x = '\0'", "X", "is no Python"),
    "nothing": ("import os", "X", "has no X; it defines nothing"),
    "another name": (HEAD + "class Y: pass\ndef f(): pass", "X", "has no X; it has Y and f"),
    "not one": ("class X: pass", "X", "is not an identifier: derive it from adhesion_jax.ident"),
    "an object": ("X = 3", "X", "is not an identifier"),
    "another kind": (HEAD + "class X(Curve): pass", "X", "is not an identifier"),
    "it raises": ("x = 1\n\ny = x / 0", "X", "line 3: ZeroDivisionError: division by zero."),
    "it ends": ("import sys\nsys.exit(3)", "X", "line 2: SystemExit: 3."),
    "it lacks": (
        HEAD + "class X(Identifier):\n def init(self, known, key): pass",
        "X",
        "lacks FITS_LAST_RECORD, RESETS, accepts, estimate and update, which an identifier must",
    ),
    "a package's name": (HEAD + "from adhesion_jax.identifiers import riv", "riv", "another part"),
}


def refusal(kind, path, name):
    with pytest.raises(InputError) as refused:
        use(part(kind, f"{path}:{name}"))
    sentence = str(refused.value)
    assert "\n" not in sentence
    assert sentence.endswith(".")
    return sentence


@pytest.mark.parametrize("case", BROKEN)
def test_a_file_that_cannot_be_used_is_answered_in_a_sentence(case, tmp_path):
    content, name, words = BROKEN[case]
    path = tmp_path / "mine.py"
    if content is not None:
        path.write_text(content)
    before = plugins.used()  # what other tests have loaded
    assert words in refusal("identifier", path, name)
    assert plugins.used() == before


def test_fields_without_values_are_named(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(FILES["cautious.py"].replace("slip: float = 0.08", "slip: float"))
    path.write_text(path.read_text().replace("time: float = 2.0", "time: float"))
    said = refusal("seeker", path, "Cautious")
    assert "cannot be made without arguments" in said
    assert "'slip' and 'time'" in said


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("def X(grade: float = 1.0): pass", "an argument that is not described"),
        ("class X: pass", "is not a function that builds a scenario"),
    ],
)
def test_a_scenario_that_is_none_is_refused(content, words, tmp_path):
    (tmp_path / "mine.py").write_text(content)
    assert words in refusal("scenario", tmp_path / "mine.py", "X")


@pytest.mark.thorough
def test_the_command_refuses_with_status_2_and_no_traceback(folder):
    (folder / "none.py").write_text("def nothing():\n    '''No scenario.'''\n")
    (folder / "shut.py").write_text("import no_such_module\n")
    for asked, words in (
        ("montecarlo --scenario none.py:nothing", "returns NoneType, and not a scenario"),
        ("montecarlo --identifiers shut.py:X", "line 1: ModuleNotFoundError"),
        ("identify eurosprinter --curve leaves.py:Leaves", "is not a curve: derive it from"),
        ("discover eurosprinter --effects hyperbolic.py:Hyperbolic", "is not an effect"),
        ("traction --system hxd1f --observer cautious.py:Cautious", "is not an observer"),
    ):
        done = ran(asked, folder)
        assert done.returncode == 2, asked
        assert words in done.stderr
        assert done.stderr.count("\n") == 1


def test_names_that_are_not_known_are_answered_with_the_way_to_a_file(folder):
    assert "or FILE.py:NAME" in ran("identify eurosprinter --curve x", folder).stderr


#: Loads a part, twice, and tells what programs depend on.
DIGEST = """
import sys
from adhesion_jax import keeping, plugins
one = plugins.part("identifier", sys.argv[1])
assert plugins.use(one) == plugins.use(one) == one.name
print(type(plugins._named("adhesion_jax.identifiers.IDENTIFIERS")[one.name]).__module__)
print(keeping.of_outside())
"""


def told_of(text, folder):
    done = subprocess.run(
        [sys.executable, "-c", DIGEST, text],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(PAGE.parents[1])},
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    )
    return done.stdout.split()


@pytest.mark.thorough
def test_programs_depend_on_the_content_of_the_files_and_not_on_their_place(tmp_path):
    for place in ("one", "other"):
        (tmp_path / place).mkdir()
        (tmp_path / place / "mine.py").write_text("import beside\n" + FILES["damped.py"])
        (tmp_path / place / "beside.py").write_text("x = 1\n")
        (tmp_path / place / "alone.py").write_text(FILES["damped.py"])
    alone = told_of("one/alone.py:DampedGaussNewton", tmp_path)
    assert alone == told_of("other/alone.py:DampedGaussNewton", tmp_path)
    before = told_of("one/mine.py:DampedGaussNewton", tmp_path)
    assert before == told_of("one/mine.py:DampedGaussNewton", tmp_path)
    (tmp_path / "one" / "beside.py").write_text("x = 2\n")
    after = told_of("one/mine.py:DampedGaussNewton", tmp_path)
    assert before[0] == after[0]
    assert before[1] != after[1]
