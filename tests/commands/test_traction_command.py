"""The command that runs a system and judges it."""

import inspect
import json
import math
import re
import sys

import pandas as pd
import pytest
from click.testing import CliRunner
from matplotlib.image import imread

import adhesion_jax as aj
from adhesion_jax.command_line.command import run
from adhesion_jax.command_line.traction import main
from adhesion_jax.library.shards import check_numbers, step_of
from adhesion_jax.metrics.closed_loop import FIGURES
from adhesion_jax.report.traction.systems import SUBJECTS
from adhesion_jax.traction.plants.reading import shipped
from adhesion_jax.traction.systems import SYSTEMS

#: Parts of one program, for what has to be run through the command.
QUICK = ["--observer", "full-dimension", "--seeker", "constant-slip", "--step", "2e-4"]


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


@pytest.mark.slow
def test_the_function_gives_the_numbers_of_the_command(written):
    out, told = written
    plant = out.parent / "light.toml"
    found = aj.traction_control(
        "hxd1f", plant, "full-dimension", "constant-slip", step=2e-4, runs=2, workers=1
    )
    for name in ("table", "metrics"):
        table = pd.read_csv(out / f"{name}.csv", keep_default_na=False, na_values=[""])
        pd.testing.assert_frame_equal(table, getattr(found, name), check_exact=True)
    assert told.startswith(repr(found).partition("\n\n")[0])
    assert "dry" in found.plot().axes[0].get_title()
    with pytest.raises(aj.InputError, match="There is no seeker x; name none, "):
        aj.traction_control("hxd1f", seeker="x")


@pytest.mark.slow
def test_the_command_writes_its_files(written):
    out, told = written
    pictures = {f"{name}.png" for name in SUBJECTS["hxd1f"].captions}
    expected = {"table.csv", "metrics.csv", "metadata.json", "report.html", *pictures}
    expected |= {"operating_point.png", "operating_point.gif", "runs.parquet", "shards"}
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
    runs = pd.read_parquet(out / "runs.parquet")
    assert [*runs] == ["scenario", "method", "noise", "run", "segment", *FIGURES]
    assert len(runs) == 4 * (1 + 2)
    noisy = runs[runs["noise"] == "yes"].groupby("segment", sort=False)["utilisation"].mean()
    assert noisy.tolist() == pytest.approx(metrics["utilisation"][4:].tolist())
    metadata = json.loads((out / "metadata.json").read_text())
    assert metadata["parameters"]["axle_load"]["value"] == [25000.0]
    assert metadata["plant_steps"] == 75_000 * (1 + 32)


@pytest.mark.slow
def test_the_page_tells_what_was_assumed_and_repaired(written):
    out, _ = written
    page = (out / "report.html").read_text(encoding="utf-8")
    for words in (
        "What was assumed",
        "What was repaired",
        "a heavy-haul train of 10,000 t",
        "Each row is a run without noise on this plant: light.",
        "Columns of metrics.csv",
        "data:image/png;base64,",
    ):
        assert words in page
    assert all(imread(file).std() > 0.02 for file in out.glob("*.png"))


@pytest.mark.slow
def test_controllers_stand_side_by_side_and_change_no_row_of_each_other(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(
        "from adhesion_jax.traction.controllers.linearised import SlidingMode\n"
        "Mine = SlidingMode(gain=900.0, layer=0.05, least=-0.3)\n"
    )
    options = ["--system", "hxd1f", *QUICK, "--runs", "0", "--controller", "mine.py:Mine,barrier"]
    found = CliRunner().invoke(main, [*options, "--out", "out"], catch_exceptions=False)
    assert found.exit_code == 0
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "Figure 15 of the paper, with the parts named here." in page
    assert "a sliding mode and with the barrier" not in page
    table = pd.read_csv("out/table.csv").set_index("method")
    beside = "observer full-dimension, seeker constant-slip, controller "
    assert [*dict.fromkeys(table.index)] == [beside + "Mine", beside + "barrier"]
    alone = aj.traction_control(
        "hxd1f",
        observer="full-dimension",
        seeker="constant-slip",
        controller="barrier",
        step=2e-4,
        runs=0,
    )
    same = alone.table.set_index("method")
    pd.testing.assert_frame_equal(table.loc[[beside + "barrier"]], same, check_exact=True)


BAD = {
    "system": (["--system", "tgv"], "--system tgv is not known; name one of"),
    "observer": (
        ["--system", "hxd1f", "--observer", "luenberger"],
        "luenberger is not known",
    ),
    "step": (["--system", "hxd1f", "--step", "5e-4"], "--step 0.0005 s is not possible"),
    "grid": (["--system", "hxd1f", "--step", "1.5e-4"], "which is no multiple of the step"),
    "period": (
        ["--system", "hxd1f", "--observer", "true-load", "--step", "3.125e-4"],
        "the control period of 0.001 s is no whole number of steps",
    ),
    "seeker": (["--system", "fang2018", "--controller", "barrier"], "has no seeker; name a seeker"),
    "law": (
        ["--system", "hxd1f", "--controller", "none", "--seeker", "constant-slip"],
        "so it takes no seeker",
    ),
    "plant": (["--system", "hxd1f", "--plant", "tgv"], "tgv does not exist; name a TOML file or"),
    "runs": (["--system", "hxd1f", "--runs", "-1"], "is not in the range"),
    "tuning": (
        ["--system", "hxd1f", "--tuning-seed", "0"],
        "--tuning-seed is no option of --system hxd1f",
    ),
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
    ("options", "words"),
    [
        ({"extend": 100}, "go on with the job in a folder; name it as out"),
        ({"resume": True}, "go on with the job in a folder; name it as out"),
        ({"animate": True}, "animate draws into a folder; name it as out"),
        ({"extend": -3, "out": "out"}, "extend is a whole number of further runs, and not -3"),
        ({"step": 0.0}, "a step is a number of seconds above 0, and not 0.0"),
        ({"step": math.nan}, "a step is a number of seconds above 0, and not nan"),
        ({"plant": ""}, "name a TOML file"),
        ({"controller": ("barrier", "barrier")}, "one name or several, each of them once"),
        ({"controller": []}, "one name or several, each of them once"),
    ],
)
def test_options_of_python_that_cannot_be_used_are_refused(options, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(aj.InputError, match=re.escape(words)):
        aj.traction_control("hxd1f", **options)
    assert not [*tmp_path.iterdir()]


@pytest.mark.parametrize(
    ("check", "given", "words"),
    [
        (check_numbers, (4.5, 1, 0), "all whole numbers"),
        (step_of, ("a", 1e-4), "a step is a number of seconds above 0, and not 'a'"),
    ],
)
def test_options_of_another_kind_are_refused_where_no_kinds_are_checked(check, given, words):
    with pytest.raises(aj.InputError, match=words):
        inspect.unwrap(check)(*given)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("value = -1.0\nunit = 'kg'", "axle_load is -1.0 kg; it must be a number from"),
        ("value = 25000.0", "axle_load needs a value and a unit"),
        ("value = 25.0\nunit = 'm'", "axle_load is given in 'm', which is no unit of it"),
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
    assert {
        "hxd1f",
        "hxd1f_axles",
        "hxd1f_twist",
        "fang2018",
        "uyulan2018",
        "uyulan2018_physical",
    } <= {*shipped()}
