"""The main command, as a user runs it."""

import json
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest
from matplotlib.image import imread

from adhesion_jax.command_line.command import Names, run
from adhesion_jax.command_line.montecarlo import main
from adhesion_jax.errors import InputError

COLUMNS = [
    *("scenario", "identifier", "rail", "quantity", "truth", "bias", "bias_se", "rmse", "rmse_se"),
    *(
        "crlb",
        "rmse_over_crlb",
        "coverage95",
        "coverage95_se",
        "coverage95_robust",
        "at_bound_share",
        "failure_share",
    ),
    *("delay_steps", "runs", "seconds_per_identification", "evaluations"),
]


def command(*arguments):
    return subprocess.run(
        [sys.executable, "-m", "experiments.montecarlo", *map(str, arguments)],
        capture_output=True,
        text=True,
        cwd=Path(__file__).parents[2],
        check=False,
        timeout=120,
    )


def test_a_small_job_writes_its_files_and_leaves_others_alone(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    done = command(
        *("--runs", 20, "--blocks", 6, "--points", 50, "--seed", 5, "--out", tmp_path),
        *("--identifiers", "ml-exact,ml-de"),
    )
    assert (done.returncode, done.stderr) == (0, "")  # no progress without a terminal
    assert "ml-de" in done.stdout
    names = {path.name for path in tmp_path.iterdir()}
    figures = {"histogram_mu_max.png", "tracking.png"}
    tables = {"summary.csv", "switches.csv", "tracking.csv", "runs.parquet", "metadata.json"}
    assert names == {"notes.txt", "shards"} | figures | tables
    summary = pd.read_csv(tmp_path / "summary.csv")
    assert [name for name in summary if name in COLUMNS] == COLUMNS
    assert len(summary) == 2 * 3 * 5
    runs = pd.read_parquet(tmp_path / "runs.parquet")
    assert sorted(set(runs["block"])) == [1, 2, 3, 4, 5]  # around the switches at 2 and 4
    assert len(runs) == 20 * 2 * 5
    assert {"run", "identifier", "block", "rail", "c1", "c1_se", "mu_max_se"} <= set(runs)
    assert {"status", "objective", "evaluations"} <= set(runs)
    metadata = json.loads((tmp_path / "metadata.json").read_text())
    assert metadata["seed"] == 5
    assert metadata["config"]["options"]["blocks"] == 6
    assert "jax" in metadata["versions"]
    assert set(runs["status"]) <= set(metadata["statuses"])
    for figure in figures:
        pixels = imread(tmp_path / figure)
        assert pixels.std() > 0.01  # something is drawn
        assert min(pixels.shape[:2]) > 400


@pytest.mark.thorough
def test_a_growing_sequence_has_its_own_figure_and_what_an_earlier_job_left_is_gone(tmp_path):
    (tmp_path / "switches.csv").write_text("of an earlier job")
    done = command(
        *("--scenario", "he2018-1", "--points", 100, "--runs", 4, "--out", tmp_path),
        *("--identifiers", "ml-exact"),
    )
    assert done.returncode == 0, done.stderr
    tables = {"summary.csv", "checkpoints.csv", "runs.parquet", "metadata.json"}
    figures = {"histogram_mu_max.png", "tracking.png", "convergence.png"}
    assert {path.name for path in tmp_path.iterdir()} == tables | figures | {"shards"}
    checkpoints = pd.read_csv(tmp_path / "checkpoints.csv")
    assert checkpoints["k"].unique().tolist() == list(range(5, 101, 5))
    assert imread(tmp_path / "convergence.png").std() > 0.01
    in_force = json.loads((tmp_path / "metadata.json").read_text())["in_force"]["he2018-1"]
    assert in_force["sigma"] == 0.01
    assert in_force["slip_max"] == 0.5
    assert in_force["points"] == 100


@pytest.mark.thorough
def test_the_main_job_has_both_scenarios_in_one_table_and_one_set_of_figures(tmp_path):
    done = command(
        *("--runs", 6, "--points", 100, "--identifiers", "ml-exact,riv,qp-qian2024-1"),
        *("--out", tmp_path),
    )
    assert done.returncode == 0, done.stderr
    figures = {"histogram_mu_max.png", "tracking.png", "bands.png"}
    assert figures < {path.name for path in tmp_path.iterdir()}
    summary = pd.read_csv(tmp_path / "summary.csv")
    assert list(dict.fromkeys(summary["scenario"])) == ["he2018-blocks", "qian2024-switch"]
    by_scenario = summary.groupby("scenario")["identifier"].unique()
    assert set(by_scenario["he2018-blocks"]) == {"ml-exact"}
    assert set(by_scenario["qian2024-switch"]) == {"riv", "qp-qian2024-1"}
    tracking = pd.read_csv(tmp_path / "tracking.csv").set_index(["identifier", "rail"])
    assert tracking.loc[("riv", "common"), "unit"] == "sample"
    assert tracking.loc[("ml-exact", "wet"), "unit"] == "block"
    bands = pd.read_csv(tmp_path / "bands.csv")
    assert set(bands["quantity"]) == {"p1", "p2", "mu_max", "slip_opt", "forgetting"}
    assert (bands["p05"] <= bands["p95"]).all()
    of_riv = bands[(bands["identifier"] == "riv") & (bands["quantity"] == "forgetting")]
    assert of_riv.set_index("block")["median"][5] == 0  # the block of the switch, at 50 of 100
    runs = pd.read_parquet(tmp_path / "runs.parquet")
    of_riv = runs[runs["identifier"] == "riv"]
    assert of_riv["p1"].notna().all()
    assert of_riv["c1"].isna().all()
    assert (runs.loc[runs["identifier"] == "ml-exact", "c1"]).notna().all()


@pytest.mark.long
def test_an_identifier_that_no_scenario_of_the_main_job_takes_is_refused(tmp_path):
    done = command("--identifiers", "rls-slope", "--out", tmp_path)
    assert done.returncode == 2
    assert "rls-slope" in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_list_names_everything():
    done = command("--list")
    assert done.returncode == 0
    for name in ("single", "he2018-1", "he2018-blocks", "ml-exact", "gn-optimistix", "wet"):
        assert name in done.stdout
    # Every name stands apart from its words.
    assert "mismatch-kiencke  " in done.stdout


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--scenario", "moon"), ("--scenario moon", "he2018-blocks")),
        (("--identifiers", "magic"), ("--identifiers magic", "ml-exact")),
        (("--runs", "0"), ("--runs", "0")),
        (("--runs", "many"), ("--runs", "many")),
        (("--sigma", "-1"), ("--sigma", "-1")),
        (("--sigma", "nan"), ("--sigma",)),
        (("--sigma", "1e300"), ("--sigma", "1e+300")),
        (("--points", "99999999999999999999"), ("--points", "99999999999999999999")),
        (("--identifiers", ""), ("--identifiers", "ml-exact")),
        (("--rail", "wet"), ("--rail", "he2018-blocks")),
        (("--scenario", "single", "--rail", "icy"), ("--rail icy", "dry")),
        (("--scenario", "single", "--blocks", "3"), ("--blocks", "single")),
        (("--blocks", "2"), ("--blocks 2", "6")),
        (("--outliers", "1.5"), ("--outliers", "1.5")),
        (("--slip-max", "0"), ("--slip-max",)),
        (("--out", "/proc/nowhere"), ("--out", "/proc/nowhere")),
        (("--surprise",), ("--surprise",)),
    ],
)
def test_what_cannot_be_used_is_answered_in_one_sentence(arguments, words, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["montecarlo", *arguments])
    with pytest.raises(SystemExit) as ended:
        run(main)
    assert ended.value.code == 2
    said = capsys.readouterr()
    assert said.out == ""
    lines = said.err.strip().splitlines()
    assert len(lines) == 1, said.err
    assert all(word in lines[0] for word in words), lines[0]


def test_two_parts_of_one_name_are_refused_and_the_same_part_twice_is_not(tmp_path):
    for place, height in (("one", 1), ("other", 2), ("copy", 1)):
        (tmp_path / place).mkdir()
        (tmp_path / place / "m.py").write_text(f"Mine = {height}\n")
    asked = Names(("riv",), "identifier")
    one, other, copy = (f"{tmp_path / place}/m.py:Mine" for place in ("one", "other", "copy"))
    with pytest.raises(InputError, match=r"one/m.py:Mine and .*other/m.py:Mine have one name"):
        asked.convert(f"{one},riv,{other}", None, None)
    for same in (one, copy):
        names = [getattr(part, "name", part) for part in asked.convert(f"{one},{same}", None, None)]
        assert names == ["Mine", "Mine"]
