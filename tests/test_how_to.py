"""The tutorial and the pages of one task each, followed as printed, each in a folder of its own."""

import contextlib
import io
import re
import shlex
import shutil
import tempfile
from pathlib import Path

import jaxtyping
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from matplotlib.image import imread

import adhesion_jax
from adhesion_jax.command_line.program import adhesion
from adhesion_jax.curves import CURVES
from adhesion_jax.errors import InputError
from adhesion_jax.simulation.locomotive_log import locomotive_log, write_csv

DOCS = Path(__file__).resolve().parents[1] / "docs"
SAMPLE = DOCS / "sample_log.csv"
PAGES = [DOCS / "tutorial.md", DOCS / "compare.md", *sorted((DOCS / "how_to").glob("*.md"))]

#: What takes longer than two seconds, and than twenty.
LONG = ("tutorial", "choose_curves", "compare_groups", "correct_signals", "plan_a_measurement")
LONG += ("several_axles", "use_the_answer")
THOROUGH = ("choose_a_method", "find_a_cause", "finish_a_job")

BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
NUMBER = re.compile(r"([^\d.-]*)(-?\d[\d,]*(?:\.\d+)?)(\D*)")
FILE = re.compile(r"# (\w+\.(?:py|toml))\n")


def printed_by(command):
    program, *words = shlex.split(command, comments=True)
    assert program == "adhesion", command
    try:
        return CliRunner().invoke(adhesion, words, catch_exceptions=False).output
    except InputError as error:
        return f"error: {error}\n"


def followed(page):
    """The blocks of a page that show what is printed, each with what was printed before it.

    A block that begins with the name of a file is written there; all others run in their order.
    """
    names, told = {"__name__": "__main__"}, ""
    for language, content in BLOCK.findall(page.read_text(encoding="utf-8")):
        file = FILE.match(content)
        if file:
            Path(file[1]).write_text(content, encoding="utf-8")
        elif language == "sh":
            commands = content.replace("\\\n", " ").splitlines()
            told = "".join(map(printed_by, commands))
        elif language == "python":
            with contextlib.redirect_stdout(io.StringIO()) as out:
                exec(content, names)
            told = out.getvalue()
        else:
            yield content, told
    plt.close("all")


@pytest.fixture(autouse=True)
def as_for_a_user(monkeypatch):
    """Numbers may stand for arrays, and what a page adds to the curves is gone afterwards."""
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    before = dict(CURVES)
    yield
    CURVES.clear()
    CURVES.update(before)


def alike(shown, printed):
    """Whether two words are the same, or numbers that differ by one in the last digit shown.

    On another processor the digits that are rounded away differ.
    """
    if shown == printed:
        return True
    one, other = NUMBER.fullmatch(shown), NUMBER.fullmatch(printed)
    if not one or not other or one.group(1, 3) != other.group(1, 3):
        return False
    places = len(one[2].partition(".")[2])
    apart = abs(float(one[2].replace(",", "")) - float(other[2].replace(",", "")))
    return apart < 1.1 * 10.0**-places


def of_one_form(shown, printed):
    """Whether two words are the same but for their numbers."""
    one, other = NUMBER.fullmatch(shown), NUMBER.fullmatch(printed)
    return shown == printed or bool(one and other and one.group(1, 3) == other.group(1, 3))


def found_in(told, part, same=alike):
    """The words that were printed where the words of a part of a page are found, or None."""
    words, printed = part.split(), told.split()
    starts = range(len(printed) - len(words) + 1)
    at = (i for i in starts if all(map(same, words, printed[i:])))
    return next((printed[i : i + len(words)] for i in at), None)


def refreshed(page):
    """The text of a page with the numbers that are printed now; its sentences are left alone."""
    text = page.read_text(encoding="utf-8")
    for content, told in followed(page):
        parts = content.split("...\n")
        for number, part in enumerate(parts):
            words = iter(found_in(told, part, of_one_form) or part.split())
            parts[number] = re.sub(r"\S+", lambda _, words=words: next(words), part)
        text = text.replace(content, "...\n".join(parts), 1)
    return text


def marks_of(page):
    if page.stem in THOROUGH:
        return pytest.mark.thorough
    return pytest.mark.long if page.stem in LONG else ()


@pytest.mark.parametrize(
    "page", [pytest.param(page, marks=marks_of(page)) for page in PAGES], ids=lambda page: page.stem
)
def test_a_page_prints_what_it_shows(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copy(SAMPLE, tmp_path)
    shown = 0
    for content, told in followed(page):
        for part in content.split("...\n"):
            assert found_in(told, part), f"{part}\nis not in\n{told}"
        shown += 1
    assert shown


def test_the_sample_is_what_the_tutorial_says(tmp_path):
    """Every tenth row of a simulated log about its slip events."""
    drawn = locomotive_log(seed=1, hours=0.3, events=3)
    for _ in write_csv(tmp_path / "log.csv", drawn):
        pass
    name, *rows = (tmp_path / "log.csv").read_text(encoding="cp1252").splitlines()
    near = pd.Series(False, index=range(0, len(rows), 10))
    for begin, seconds, *_ in drawn.events:
        near |= (near.index / 100 >= begin - 6) & (near.index / 100 <= begin + seconds + 6)
    kept = [rows[number] for number in near.index[near]]
    assert SAMPLE.read_text(encoding="cp1252").splitlines() == [name, *kept]


def test_the_sentences_that_the_tutorial_explains_are_those_of_the_package():
    package = Path(adhesion_jax.__file__).parent
    source = "".join(path.read_text(encoding="utf-8") for path in package.rglob("*.py"))
    # A sentence goes on in the next line, of a template as of a program.
    said = re.sub(r'"\s*\n\s*f?"', "", source)
    templates = (package / "report/templates").glob("*.txt")
    said += re.sub(r"\s+", " ", "".join(path.read_text(encoding="utf-8") for path in templates))
    tables = (DOCS / "tutorial.md").read_text(encoding="utf-8").split("## 4.")[1].split("## 5.")[0]
    explained = re.findall(r"^\| `([^`]+)`", tables, re.MULTILINE)
    assert len(explained) > 15
    parts = [part.strip() for words in explained for part in words.split("...")]
    assert [part for part in parts if part not in said] == []


@pytest.mark.thorough
def test_the_gallery_shows_what_its_lines_draw(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copy(SAMPLE, tmp_path)
    assert list(followed(DOCS / "gallery.md")) == []
    shown = re.findall(r"!\[[^]]+\]\((gallery/\w+\.png)\)", (DOCS / "gallery.md").read_text())
    assert len(shown) == 12
    assert {*shown} == {f"gallery/{path.name}" for path in (DOCS / "gallery").iterdir()}
    for name in shown:
        drawn, kept = imread(tmp_path / name), imread(DOCS / name)
        assert drawn.shape == kept.shape
        assert np.abs(drawn - kept).mean() < 0.005  # what digits that rounding moves may change
        assert (DOCS / name).stat().st_size < 60_000


if __name__ == "__main__":  # after a change that is meant to move numbers
    for one in PAGES:
        with tempfile.TemporaryDirectory() as scratch, contextlib.chdir(scratch):
            shutil.copy(SAMPLE, scratch)
            before = dict(CURVES)
            new = refreshed(one)
            CURVES.clear()
            CURVES.update(before)
        one.write_text(new, encoding="utf-8")
