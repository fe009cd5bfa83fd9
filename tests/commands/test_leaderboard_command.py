"""The leaderboard as a command and as a function: its files, and what it refuses."""

import json
import re
import sys
from pathlib import Path

import pandas as pd
import pytest

import adhesion_jax as aj
from adhesion_jax.campaign.store import FOLDER
from adhesion_jax.command_line.command import run
from adhesion_jax.command_line.program import adhesion
from adhesion_jax.curves import Burckhardt
from adhesion_jax.leaderboard.runs import _runs
from adhesion_jax.leaderboard.table import COLUMNS
from adhesion_jax.library.leaderboard import LEADERBOARD_FILES
from adhesion_jax.report.leaderboard.page import leaderboard_page
from adhesion_jax.traction.controllers import CONTROLLERS
from adhesion_jax.traction.entrants import ENTRANTS, Entrant, entrant_of, numbers
from adhesion_jax.traction.families import FAMILIES
from adhesion_jax.traction.observers import OBSERVERS
from adhesion_jax.traction.signals import Signals
from adhesion_jax.traction.systems import SYSTEMS

PAGE = (Path(__file__).parents[2] / "docs" / "leaderboard.md").read_text(encoding="utf-8")

#: The first .4 s of two runs, three seeds.
QUICK = {"runs": 2, "budget": 2, "duration": 0.4}


def mine():
    """The seeker that the page shows."""
    content = re.search(r"```python\n# mine\.py\n(.*?)```", PAGE, re.DOTALL)[1]
    names = {"__name__": "mine"}
    exec(content, names)
    return names["Mine"]


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    out = tmp_path_factory.mktemp("board") / "out"
    methods = {"mine": mine(), "constant-slip": ENTRANTS["constant-slip"]}
    with pytest.MonkeyPatch.context() as patch:
        # So short runs take less time than their programs take to compile.
        patch.setitem(_runs.options, "xla_backend_optimization_level", "0")
        yield out, aj.traction_leaderboard(methods, **QUICK, out=out)


@pytest.mark.long
def test_a_board_has_its_files_and_a_row_for_each_method(written):
    out, found = written
    of_track = {"robustness.csv", "robustness.png"}
    assert {file.name for file in out.iterdir()} == {*LEADERBOARD_FILES, FOLDER} - of_track
    table = pd.read_csv(out / "leaderboard.csv", keep_default_na=False, na_values=[""])
    assert [name for name in table if not name.endswith("_se")] == [*COLUMNS]
    optima = {"true-optimum", "true-optimum-1", "true-optimum-3"}
    assert {*table["method"]} == {"mine", "constant-slip", *optima}
    of_method = table.set_index("method")
    assert sorted(of_method["rank"].dropna()) == [1, 2]
    assert of_method.loc[["mine", "constant-slip"], "remark"].isna().all()
    assert "seeker factor" in of_method.loc["mine", "tuned"]
    assert (of_method["microseconds"] > 0).all()
    # No method beats the optimum of a price at its own price by more than its error.
    for price in (0, 1, 3):
        share, error = (of_method[f"utility_{price}_share{end}"] for end in ("", "_se"))
        assert (share <= 1 + 3 * error + 0.002).all()
    page = (out / "report.html").read_text()
    assert all(words in page for words in ("Which method when", "mine", 'class="quiet"'))
    assert "nan" not in re.sub(r'src="data:[^"]*"', "", page)
    told = json.loads((out / "metadata.json").read_text())
    assert told["seeds"] == [0, 1, 2]
    assert told["call"]["function"] == "traction_leaderboard"
    assert len(pd.read_parquet(out / "segments.parquet")) == 5 * 6 * 4
    assert "million a CPU-second" in repr(found)


@pytest.mark.thorough
def test_what_was_interrupted_goes_on_to_the_same_numbers(written):
    out, found = written
    for name in ("tuning-00001", "judging-00003"):
        (out / FOLDER / f"{name}.npz").unlink()
    (out / "leaderboard.csv").unlink()
    methods = {"mine": mine(), "constant-slip": ENTRANTS["constant-slip"]}
    again = aj.traction_leaderboard(methods, **QUICK, out=out, resume=True)
    clock = ["microseconds"]
    pd.testing.assert_frame_equal(
        again.table.drop(columns=clock), found.table.drop(columns=clock), check_exact=True
    )
    with pytest.raises(
        aj.InputError, match="holds another job: --budget of tuning is 2 there and 3 here"
    ):
        aj.traction_leaderboard(methods, **{**QUICK, "budget": 3}, out=out, resume=True)


@pytest.mark.thorough
def test_two_files_of_one_name_are_two_rails(tmp_path):
    paths = {}
    for name, level in (("dry", 0.4), ("wet", 0.2)):
        paths[name] = tmp_path / name / "curves.csv"
        paths[name].parent.mkdir()
        paths[name].write_text("curve,rms\n")
        columns = {"log.csv": [{"column": "slip", "taken_as": "slip_ratio"}]}
        told = {"columns": columns, "vetoes": {"dry": [], "wet": ["It is oil."]}[name]}
        (tmp_path / name / "metadata.json").write_text(json.dumps(told))
        aj.save_law(tmp_path / name / "law.json", Burckhardt(c1=level, c2=80.0, c3=0.5))
    found = aj.traction_leaderboard(
        "constant-slip", rails=[*paths.values()], runs=1, budget=1, duration=0.2
    )
    pull = found.table[found.table["method"] == "true-optimum"].set_index("rails")["pull"]
    dry, wet = (pull[str(path)] for path in paths.values())
    assert 1.5 < dry / wet < 2.1
    rows = found.segments[found.segments["method"] == "constant-slip"]
    assert rows.groupby("rails").size().tolist() == [6, 6]
    page = leaderboard_page(found.table, found.plant, SYSTEMS["hxd1f"], found.told)
    for told in (repr(found), str(page.sections)):
        assert (
            told.count("gave no answer, so that a train may never meet such rails: It is oil") == 1
        )


REFUSED = {
    "--methods nobody": "--methods nobody is not known; name one of true-optimum, ",
    "--budget 0": "Invalid value for '--budget': 0 is not in the range",
    "--rails flat": "flat does not exist; name exponential, ",
    "--seed 2025 --runs 1": "methods would be judged on the rails that they are tuned on",
    "--seeker none": "--seeker is no option of --system leaderboard; leave it out.",
    "--law nothing.json": "nothing.json does not exist; name a law.json",
    "--beside nothing.csv": "nothing.csv does not exist; name a leaderboard.csv.",
    "--system hxd1f --budget 3": "--budget is no option of --system hxd1f; leave it out.",
    "--methods bad.py:Bad": "bad.py:Bad is no seeker: it lacks init and update. ",
}


@pytest.mark.parametrize("words", REFUSED)
def test_what_cannot_be_used_is_refused_in_a_sentence(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("bad.py").write_text("class Bad:\n    pass\n")
    system = [] if "--system" in words else ["--system", "leaderboard"]
    monkeypatch.setattr(sys, "argv", ["adhesion", "traction", *system, *words.split()])
    with pytest.raises(SystemExit) as ended:
        run(adhesion)
    told = capsys.readouterr().err
    assert ended.value.code == 2
    assert told.startswith("error: ")
    assert REFUSED[words] in told
    assert told.count("\n") == 1


def test_functions_refuse_in_words():
    for asked, words in (
        ({"budget": 0}, "a budget of 0 configurations is not possible"),
        ({"methods": ["nobody"]}, "There is no method nobody; name some of true-optimum, "),
        ({"methods": {"gradient": mine()}}, "gradient is the name of a method of the package"),
        ({"rails": "flat"}, "There are no rails flat; name exponential, "),
        ({"tuning_seed": 1}, "the seeds of judging are 0 to 2, and that of tuning is 1"),
        ({"beside": __file__}, "is no table; name a leaderboard.csv"),
    ):
        with pytest.raises(aj.InputError, match=words):
            aj.traction_leaderboard(**{**QUICK, **asked})


@pytest.mark.parametrize("name", ["seeker", "controller", "whole law", "observer"])
def test_a_part_of_a_loop_is_a_method_with_the_parts_that_all_share(name):
    shared = ENTRANTS["offset-curve"]
    own = {
        "seeker": mine(),
        "controller": CONTROLLERS["linearised-pi"],
        "whole law": CONTROLLERS["slope-feedback"],
        "observer": OBSERVERS["kalman"],
    }[name]
    made = entrant_of("own", own)
    assert (made.controller is own) == (name in ("controller", "whole law"))
    assert (made.observer is own) == (name == "observer")
    assert (made.seeker is None) == (name == "whole law")
    if name == "seeker":
        assert numbers(made)[0] == "seeker.seeker.factor"
        assert made[1:] == shared[1:]


def test_the_page_tells_every_column_every_signal_and_all_rails():
    for name in (*COLUMNS, *Signals._fields, *FAMILIES):
        assert f"`{name}`" in PAGE, name


def test_every_entrant_has_what_a_loop_needs():
    for name, entrant in ENTRANTS.items():
        assert isinstance(entrant, Entrant), name
        assert (entrant.seeker is not None) == entrant.controller.FOLLOWS, name
