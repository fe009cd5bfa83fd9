"""`adhesion track`, and the function behind it."""

import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from matplotlib.image import imread

import adhesion_jax as aj
from adhesion_jax.command_line.track import main
from adhesion_jax.library.track import METHODS, TRACK_FILES

COLUMNS = (
    "identifier time_s sample mu_max mu_max_se mu_max_lo mu_max_hi slip_opt slip_opt_se status "
    "at_least reset resets skipped"
)


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    """The command on the shipped locomotive, into a folder that holds other files."""
    out = tmp_path_factory.mktemp("track")
    (out / "notes.txt").write_text("mine")
    (out / "track.csv").write_text("old")
    result = CliRunner().invoke(main, ["eurosprinter", "--out", str(out)], catch_exceptions=False)
    assert result.exit_code == 0
    return out, result.output


def test_the_files_and_their_neighbours(told):
    out, output = told
    assert {path.name for path in out.iterdir()} == {*TRACK_FILES, "notes.txt"}
    table = pd.read_csv(out / "track.csv")
    assert list(table.columns) == COLUMNS.split()
    assert list(table["identifier"].unique()) == list(METHODS)
    assert table["time_s"].isna().all()
    for _, rows in table.groupby("identifier"):
        assert list(rows["sample"]) == list(range(1, 164))
    half = table["mu_max_hi"] - table["mu_max"]
    np.testing.assert_allclose(half[half.notna()], 1.96 * table["mu_max_se"][half.notna()])
    assert imread(out / "track.png").std() > 0.05
    assert (out / "track.txt").read_text().strip() in output


def test_what_is_said_of_the_locomotive(told):
    output = " ".join(told[1].split())
    assert "There is no time_s: the samples are followed in the order of the rows." in output
    assert "Elektrische Bahnen" in output
    # The nearest curve of Kiencke in adhesion identify: a0 = 178 +- 20, peak .3035 +- .0022.
    assert "a0 = 178 ± 20" in output
    assert "standard error 11 %" in output
    riv = next(line for line in told[1].splitlines() if line.startswith("riv "))
    assert float(riv.split()[1]) == pytest.approx(0.3037, abs=0.003)
    assert "TRUSTED" in riv


def test_the_function_does_what_the_command_does(told):
    out, _ = told
    found = aj.track(pd.read_csv(aj.SHIPPED["eurosprinter"].path), ["riv"])
    table = pd.read_csv(out / "track.csv").query("identifier == 'riv'").reset_index(drop=True)
    pd.testing.assert_frame_equal(
        found.estimates.drop(columns="time_s"), table.drop(columns="time_s")
    )
    assert found.summary["mu_max"].item() == table["mu_max"].iloc[-1]
    assert "the data frame has 163 samples" in found.verdict
    assert "<table" in found._repr_html_()
    assert "riv" in repr(found)


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"identifiers": "ml-exact"}, "ml-exact cannot follow a log: it takes whole blocks"),
        ({"identifiers": ["nobody"]}, "no identifier nobody"),
        ({"identifiers": []}, "no identifier named"),
        ({"initial_slope": 0.0}, "give a positive number"),
        ({"initial_slope": float("nan")}, "give a positive number"),
        ({"events": True}, "has no column time_s"),
    ],
)
def test_what_cannot_be_used_is_refused_in_a_sentence(asked, words):
    with pytest.raises(aj.InputError, match=words):
        aj.track("eurosprinter", **asked)


def test_a_log_that_never_slips_is_refused_and_nothing_is_written(tmp_path):
    random = np.random.default_rng(0)
    rows = 2000
    pd.DataFrame(
        {
            "time_s": 0.1 * np.arange(rows),
            "vehicle_speed_mps": 10.0,
            "slip_ratio": 0.003 + 0.0005 * random.normal(size=rows),
            "adhesion": 0.1 + 0.01 * random.normal(size=rows),
        }
    ).to_csv(tmp_path / "calm.csv", index=False)
    result = CliRunner().invoke(main, [str(tmp_path / "calm.csv"), "--out", str(tmp_path / "out")])
    assert isinstance(result.exception, aj.InputError)
    assert "has no slip event" in str(result.exception)
    assert not list((tmp_path / "out").glob("track*"))


@pytest.mark.long
def test_a_method_of_ones_own(tmp_path):
    (tmp_path / "gentle.py").write_text(
        "from adhesion_jax.identifiers.ls_kiencke import RecursiveLeastSquares\n"
        "gentle = RecursiveLeastSquares(0.999, 0.999, 0.0)\n"
    )
    # In a process of its own, for the method stays in the registry.
    asked = ["eurosprinter", "--identifiers", "gentle.py:gentle", "--initial-slope", "175"]
    done = subprocess.run(
        [sys.executable, "-m", "adhesion_jax", "track", *asked, "--out", "."],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    table = pd.read_csv(tmp_path / "track.csv")
    assert set(table["identifier"]) == {"gentle"}
    assert table["mu_max"].iloc[-1] == pytest.approx(0.304, abs=0.006)
    assert "a0 = 175, as given" in done.stdout
