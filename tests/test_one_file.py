"""A new effect, curve or method is one file and one line: shown on a copy of the package."""

import ast
import inspect
import json
import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import adhesion_jax
from adhesion_jax.effects.api import Facts
from adhesion_jax.errors import InputError
from experiments.campaigns.plantable import PLANTABLE, Planting, of_strength
from experiments.campaigns.simulator import simulate

pytestmark = pytest.mark.thorough  # all rest on one process that imports and compiles anew

PACKAGE = Path(adhesion_jax.__file__).parent
HERE = Path(__file__).parent
PAGE = HERE.parent / "docs" / "extending.md"

#: What is copied: sources, and the files that are read beside them.
KEPT = (".py", ".pyi", ".csv", ".html", ".toml", ".txt")


def section_of(heading: str) -> str:
    """What stands under a heading of the page, up to the next one."""
    return PAGE.read_text(encoding="utf-8").split(f"\n{heading}\n")[1].split("\n##")[0]


def effect_of_page() -> str:
    """The file that the page tells to write."""
    section = section_of("### A new effect in one file")
    (example,) = re.findall(r"```python\n(# leaves.py\n.*?)```", section, re.DOTALL)
    return example


def identifier_of_page() -> str:
    """The file that the page tells to write for a new method."""
    section = section_of("## A new method in one file")
    (example,) = re.findall(r"```python\n(.*?)```", section, re.DOTALL)
    return example


def lines_added(file: Path, mapping: str, entry: str, line: str) -> None:
    """One line into a registry, and the import that it needs."""
    text = file.read_text()
    opened = re.search(rf"^{mapping}: .* = {{\n", text, re.MULTILINE)
    added = f"{text[: opened.end()]}    {entry}\n{text[opened.end() :]}"
    first = re.search(r"^from ", added, re.MULTILINE).start()
    file.write_text(f"{added[:first]}{line}\n{added[first:]}")


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    """What a copy of the package makes of an effect and a curve that were added to it."""
    home = tmp_path_factory.mktemp("home")
    package = home / "adhesion_jax"
    for file in PACKAGE.rglob("*"):
        if file.suffix in KEPT:
            place = package / file.relative_to(PACKAGE)
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(file, place)

    (package / "effects" / "leaves.py").write_text(effect_of_page())
    lines_added(
        package / "effects" / "__init__.py",
        "EFFECTS",
        '"leaves": Leaves,',
        "from adhesion_jax.effects.leaves import Leaves",
    )
    shutil.copy(HERE / "one_file" / "hyperbolic.py", package / "curves")
    lines_added(
        package / "curves" / "__init__.py",
        "CURVES",
        '"hyperbolic": Hyperbolic(a=0.3, b=50.0, c=0.3),',
        "from adhesion_jax.curves.hyperbolic import Hyperbolic",
    )
    (package / "identifiers" / "damped.py").write_text(identifier_of_page())
    lines_added(
        package / "identifiers" / "__init__.py",
        "IDENTIFIERS",
        '"damped": DampedGaussNewton(),',
        "from adhesion_jax.identifiers.damped import DampedGaussNewton",
    )

    out = home / "out"
    out.mkdir()
    done = subprocess.run(
        [sys.executable, HERE / "one_file" / "use.py", out],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(home), str(HERE.parent)])},
        cwd=home,
        capture_output=True,
        text=True,
        check=False,
        timeout=400,
    )
    assert done.returncode == 0, done.stderr
    answers = json.loads((out / "told.json").read_text())
    assert answers["package"] == str(package)
    return answers


@pytest.mark.parametrize("form", ["exact", "perturbed"])
def test_the_new_effect_is_planted_on_the_new_curve_by_both_formulas(told, form):
    simulated = told[f"simulated {form}"]
    assert simulated["truth"] == ["leaves"]
    assert simulated["base"] == "hyperbolic"
    assert [*simulated["parameters"]] == ["k" if form == "exact" else "amount"]
    assert simulated["cover_of_runs"] == 1
    # 1 - k w, or exp(-a w^2), on a tanh(b l) - c l; the noise is 1e-9.
    assert simulated["largest_error"] < 1e-7


def test_its_column_is_there_where_it_is_planted_and_nowhere_else(told):
    assert "leaf_cover" not in told["bare"]["columns"]
    assert told["bare"]["visible"] < 1e-3


def test_the_new_effect_is_found_with_the_strength_that_was_planted(told):
    found = told["found"]
    # How often a second claim stands beside a right one is counted elsewhere, over many sets.
    assert found["effects"][0] == "leaves"
    assert found["rests_on"][0] == ["leaf_cover"]
    value, low, high = found["intervals"][0]["k"]
    # 95 % intervals, at 3.3 standard errors: one in a thousand misses.
    error = (high - low) / 3.92
    assert value == pytest.approx(found["planted"]["k"], abs=3.3 * error)
    assert error < 0.1 * found["planted"]["k"]
    # A twentieth above the noise, as for the package's own, on test runs inside the ranges of the
    # others: outside them an effect is held at the edge.
    (low, high), (test_low, test_high) = found["ranges"]
    assert low < test_low < test_high < high
    assert found["after"] < 1.05 * found["noise"]


def test_the_new_curve_below_it_is_the_one_of_the_simulation(told):
    found = told["found"]
    assert found["base"] == "hyperbolic"
    for name, true in found["true_curve"].items():
        assert found["curve"][name] == pytest.approx(true, abs=3.3 * found["curve_error"][name])


def test_the_law_of_the_report_is_loaded_and_gives_the_same(told):
    found = told["found"]
    np.testing.assert_allclose(found["of_loaded_law"], found["of_law"], rtol=1e-12)
    value, _, _ = found["intervals"][0]["k"]
    np.testing.assert_allclose(found["factor"], 1 - 0.8 * value, rtol=1e-9)


def test_the_report_speaks_in_the_words_of_the_effect(told):
    report = told["found"]["report"]
    example = re.findall(
        r'"([^"]*)",  # for the reader', section_of("### A new effect in one file")
    )
    assert example
    assert example[0] in report
    assert "leaves on the rail" in report.lower()
    assert "mu (1 - k w)" in report


def test_the_study_gives_the_effect_tasks_and_judges_it_right(told):
    assert sorted(told["tasks"]) == ["exact", "perturbed"]
    judged = told["judged"]
    told_of = ("in_class", "first_right", "all_named", "detected", "worse")
    assert [judged[name] for name in told_of] == [True, True, True, True, False]
    assert judged["removed"] > 0.95


def test_the_new_curve_is_identified_by_the_command(told):
    assert "hyperbolic" in told["known"]
    row = told["identified"]
    assert row["curve"] == "hyperbolic"
    assert row["status"].startswith("TRUSTED")
    for own, name, true in zip(told["parameters"], "abc", told["curve"], strict=True):
        assert own["parameter"] == name
        assert own["value"] == pytest.approx(true, abs=3.3 * own["se"])
    a, b, c = told["curve"]
    assert row["slip_opt"] == pytest.approx(
        np.arccosh(np.sqrt(a * b / c)) / b, abs=3.3 * row["slip_opt_se"]
    )


def test_the_new_method_is_measured_among_the_others_and_reaches_the_bound(told):
    measured = told["campaign"]
    assert {row["identifier"] for row in measured} == {"damped", "ml-exact"}
    (row,) = [row for row in measured if row["identifier"] == "damped"]
    assert row["runs"] == 256
    assert row["rmse_over_crlb"] == pytest.approx(1, abs=3.3 * row["rmse_over_crlb_se"])
    assert row["coverage95"] == pytest.approx(0.95, abs=3.3 * row["coverage95_se"])
    assert row["failure_share"] < 0.02


# --------------------------------------------------------------------------- what is forgotten


def written() -> ast.ClassDef:
    (found,) = [part for part in ast.parse(effect_of_page()).body if isinstance(part, ast.ClassDef)]
    return found


def name_of(part: ast.stmt) -> str:
    if isinstance(part, ast.FunctionDef):
        return part.name
    (target,) = part.targets if isinstance(part, ast.Assign) else (part.target,)
    return target.id


def facts_of(effect: ast.ClassDef) -> ast.Call:
    (found,) = [part.value for part in effect.body if name_of(part) == "FACTS"]
    return found


def page_without(declared: str = "", fact: str = "") -> dict[str, object]:
    """What the file of the page defines, but for one declaration of the class or one fact."""
    module = ast.parse(effect_of_page())
    (effect,) = [part for part in module.body if isinstance(part, ast.ClassDef)]
    facts = facts_of(effect)
    facts.keywords = [one for one in facts.keywords if one.arg != fact]
    effect.body = [part for part in effect.body if name_of(part) != declared]
    space: dict[str, object] = {"__name__": "leaves"}
    exec(compile(module, "leaves.py", "exec"), space)
    return space


DECLARED = [name_of(part) for part in written().body if name_of(part) != "k"]
#: The facts of the page that have no default.
FACTS = [
    one.arg
    for one in facts_of(written()).keywords
    if inspect.signature(Facts).parameters[one.arg].default is inspect.Parameter.empty
]


def test_the_example_declares_all_and_is_an_effect():
    leaves = page_without()["Leaves"]
    assert float(leaves(k=0.25).factor(0.0, {"leaf_cover": 0.4})) == pytest.approx(0.9)
    assert {"FACTS", "factor"} == {*DECLARED}


@pytest.mark.parametrize("declared", [name for name in DECLARED if name != "FACTS"])
def test_an_effect_that_forgets_a_method_cannot_be_made(declared):
    with pytest.raises(TypeError, match=rf"abstract[^\n]*\b{declared}\b"):
        page_without(declared)["Leaves"](k=0.1)


@pytest.mark.parametrize("fact", FACTS)
def test_an_effect_that_forgets_a_fact_is_not_even_read(fact):
    with pytest.raises(TypeError, match=rf"missing[^\n]*'{fact}'"):
        page_without(fact=fact)


def test_an_effect_without_facts_cannot_be_made():
    with pytest.raises(TypeError, match=r"abstract[^\n]*FACTS"):
        page_without("FACTS")["Leaves"](k=0.1)


def test_an_effect_that_declares_no_starts_is_refused_where_it_is_first_tried():
    effect = page_without()["Leaves"]
    bare = type("Bare", (effect,), {"FACTS": replace(effect.FACTS, starts=())})
    with pytest.raises(TypeError, match="Bare declares no starts"):
        bare.starts({})


def test_an_effect_that_forgets_how_it_is_planted_is_never_planted_as_nothing(monkeypatch):
    sizes = {"seed": 0, "runs": 6, "points": 20}
    with pytest.raises(InputError, match="no way to plant 'forgotten'"):
        simulate(["forgotten"], **sizes)
    leaves = page_without()["Leaves"]
    monkeypatch.setitem(PLANTABLE, "Leaves", Planting(of_strength(leaves, 0.9)))
    with pytest.raises(KeyError, match="leaf_cover"):
        simulate(["Leaves"], **sizes)


def test_the_example_passes_the_types_of_the_project(tmp_path):
    (tmp_path / "leaves.py").write_text(effect_of_page())
    settings = ("--config-file", PAGE.parents[1] / "pyproject.toml", "--cache-dir", tmp_path)
    done = subprocess.run(
        [sys.executable, "-m", "mypy", *settings, tmp_path / "leaves.py"],
        cwd=PAGE.parents[1],
        capture_output=True,
        text=True,
        check=False,
        timeout=400,
    )
    assert done.returncode == 0, done.stdout
