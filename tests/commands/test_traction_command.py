"""Many runs of a system, and the command that judges them."""

import json
import sys

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from matplotlib.image import imread

from adhesion_jax.campaign.traction import judge, units
from adhesion_jax.commands.command import run
from adhesion_jax.commands.traction import main
from adhesion_jax.metrics.closed_loop import FIGURES
from adhesion_jax.report.traction import SUBJECTS
from adhesion_jax.studies.claims.hxd1f import settling
from adhesion_jax.studies.claims.traction import plant_of
from adhesion_jax.traction.loop import timing
from adhesion_jax.traction.observers.full_dimension import FullDimension
from adhesion_jax.traction.plants.reading import shipped
from adhesion_jax.traction.systems import SYSTEMS
from adhesion_jax.traction.systems.base import built, with_parts

#: Parts of one program, for what has to be run through the command.
QUICK = ["--observer", "full-dimension", "--seeker", "constant-slip", "--step", "2e-4"]


def judged(runs, workers=1, name="hxd1f", duration=0.3, seed=0):
    system = SYSTEMS[name]._replace(duration=duration)
    plant = plant_of(system)
    cases = with_parts(system.cases(system.step), "full-dimension", "constant-slip", "barrier")
    period = system.control_period or system.step
    grids = [timing(built(system, case, plant), system.step, period, duration) for case in cases]
    told = []
    found = judge(system, cases, plant, grids, runs, seed, told.append, workers)
    assert len(told) == units(system, cases, plant, grids, runs)
    return found


@pytest.fixture(scope="module")
def few():
    return judged(40)


def test_runs_have_their_numbers_from_seed_and_run_alone(few):
    # 3 runs are in a tile of 32, 40 in one of 64: the first three are the same to the bit.
    three, again = judged(3), judged(3)
    pd.testing.assert_frame_equal(three.metrics, again.metrics, check_exact=True)
    other = judged(3, seed=1)
    noisy = three.metrics["noise"] == "yes"
    assert (three.metrics["utilisation"] != other.metrics["utilisation"])[noisy].any()
    quiet = few.metrics["noise"] == "none"
    pd.testing.assert_frame_equal(
        few.metrics[quiet], three.metrics[~noisy], check_exact=True, check_like=True
    )


def test_processes_give_the_numbers_of_one(few):
    pd.testing.assert_frame_equal(few.metrics, judged(40, workers=2).metrics, check_exact=True)


def test_runs_of_any_number_have_the_same_mean_and_deviation(few):
    twenty = judged(20).metrics
    noisy = (twenty["noise"] == "yes") & (twenty["segment"] == "dry")
    one, many = twenty[noisy].iloc[0], few.metrics[noisy].iloc[0]
    for name in ("utilisation", "tracking_rms", "adhesion_rms"):
        # sd/sqrt(n - 1), of twenty runs and of forty.
        deviations = np.sqrt([19, 39]) * [one[f"{name}_se"], many[f"{name}_se"]]
        assert 0.5 < deviations[0] / deviations[1] < 2
        assert abs(one[name] - many[name]) < 5 * np.hypot(one[f"{name}_se"], many[f"{name}_se"])


def test_parts_take_the_place_of_the_papers():
    system = SYSTEMS["uyulan2018"]
    cases = system.cases(system.step)
    assert with_parts(cases, None, None, None) is cases
    found = with_parts(cases, "kalman", None, None)
    assert [case.scenario for case in found] == list(dict.fromkeys(c.scenario for c in cases))
    assert {case.method for case in found} == {"observer kalman"}
    assert all(case.seeker is cases[0].seeker for case in found)
    whole_law = with_parts(cases, None, None, "slope-feedback")
    assert all(case.seeker is None for case in whole_law)


def test_a_double_pole_settles_as_its_step_response():
    plant = plant_of(SYSTEMS["hxd1f"])
    # (1 + x) exp(-x) = .02 at x = 5.83; means over 2 ms.
    assert settling(FullDimension(-100.0), plant) == pytest.approx(0.0583, abs=0.0025)


@pytest.mark.parametrize("name", SYSTEMS)
def test_every_system_has_its_table_and_figures_with_captions(name):
    subject, system = SUBJECTS[name], SYSTEMS[name]
    assert system.repairs
    assert system.assumptions
    assert all(caption.startswith("Figure") for caption in subject.captions.values())
    assert len({case.scenario + case.method for case in system.cases(system.step)}) == len(
        system.cases(system.step)
    )


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The command on a plant of a user's: an HXD1F with axles of 25 t."""
    folder = tmp_path_factory.mktemp("traction")
    plant = folder / "light.toml"
    plant.write_text(
        'like = "hxd1f"\ntitle = "light"\n[parameters.axle_load]\nvalue = 25000.0\nunit = "kg"\n'
    )
    out = folder / "out"
    options = ["--system", "hxd1f", "--plant", str(plant), *QUICK, "--runs", "2", "--animate"]
    found = CliRunner().invoke(main, [*options, "--out", str(out)], catch_exceptions=False)
    assert found.exit_code == 0
    return out, found.output


def test_the_command_writes_its_files(written):
    out, told = written
    pictures = {f"{name}.png" for name in SUBJECTS["hxd1f"].captions}
    expected = {"table.csv", "metrics.csv", "metadata.json", "report.html", *pictures}
    expected |= {"operating_point.png", "operating_point.gif"}
    assert {file.name for file in out.iterdir()} == expected
    assert "plant steps" in told
    table = pd.read_csv(out / "table.csv")
    assert [*table][:5] == ["method", "segment", "utilisation", "t95_s", "torque_variation_kNm_s"]
    assert table["segment"].tolist() == ["dry", "wet", "snow"]
    metrics = pd.read_csv(out / "metrics.csv")
    paired = [column for name in FIGURES for column in (name, f"{name}_se")]
    assert [*metrics] == ["scenario", "method", "segment", "noise", *paired, "status"]
    assert metrics["noise"].tolist() == ["none"] * 4 + ["yes"] * 4
    assert metrics["utilisation"].between(0, 1).all()
    metadata = json.loads((out / "metadata.json").read_text())
    assert metadata["parameters"]["axle_load"]["value"] == [25000.0]
    assert metadata["plant_steps"] == 75_000 * (1 + 32)


def test_the_page_tells_what_was_assumed_and_repaired(written):
    out, _ = written
    page = (out / "report.html").read_text(encoding="utf-8")
    for words in (
        "What was assumed",
        "What was repaired",
        "a heavy-haul train of 10,000 t",
        "Columns of metrics.csv",
        "data:image/png;base64,",
    ):
        assert words in page
    assert all(imread(file).std() > 0.02 for file in out.glob("*.png"))


BAD = {
    "system": (["--system", "tgv"], "'tgv' is not one of"),
    "observer": (["--system", "hxd1f", "--observer", "luenberger"], "is not one of"),
    "step": (["--system", "hxd1f", "--step", "5e-4"], "--step 0.0005 s is not possible"),
    "grid": (["--system", "hxd1f", "--step", "1.5e-4"], "which is no multiple of the step"),
    "period": (
        ["--system", "hxd1f", "--observer", "true-load", "--step", "3.125e-4"],
        "the control period of 0.001 s is no whole number of steps",
    ),
    "seeker": (["--system", "fang2018", "--controller", "barrier"], "has no seeker; name one"),
    "law": (
        ["--system", "hxd1f", "--controller", "none", "--seeker", "constant-slip"],
        "which follows no seeker",
    ),
    "plant": (["--system", "hxd1f", "--plant", "tgv"], "is neither a file nor a plant that ships"),
    "runs": (["--system", "hxd1f", "--runs", "-1"], "is not in the range"),
}


@pytest.mark.parametrize("case", BAD)
def test_what_cannot_be_run_is_refused_in_a_sentence(case, tmp_path, monkeypatch, capsys):
    options, words = BAD[case]
    monkeypatch.setattr(sys, "argv", ["traction", *options, "--out", str(tmp_path / "out")])
    with pytest.raises(SystemExit) as left:
        run(main)
    assert left.value.code == 2
    told = capsys.readouterr().err
    assert words in told
    assert told.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("value = -1.0\nunit = 'kg'", "axle_load is -1.0; it must be a number from"),
        ("value = 25000.0", "axle_load needs a value and a unit"),
        ("value = 25.0\nunit = 't'", "axle_load is given in 't'; it must be in 'kg'"),
    ],
)
def test_a_plant_that_is_none_is_refused_with_its_file(text, words, tmp_path, monkeypatch, capsys):
    plant = tmp_path / "mine.toml"
    plant.write_text(f'like = "hxd1f"\n[parameters.axle_load]\n{text}\n')
    monkeypatch.setattr(sys, "argv", ["traction", "--system", "hxd1f", "--plant", str(plant)])
    with pytest.raises(SystemExit) as left:
        run(main)
    assert left.value.code == 2
    told = capsys.readouterr().err
    assert str(plant) in told
    assert words in told


def test_plants_that_ship_are_named():
    assert {"hxd1f", "hxd1f_axles", "fang2018", "uyulan2018", "uyulan2018_physical"} <= {*shipped()}
