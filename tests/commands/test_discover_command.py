import json
import sys

import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest
from discovery_campaigns import SIZE

from adhesion_jax.command_line.command import run
from adhesion_jax.command_line.discover import main
from adhesion_jax.effects.saved import load_law
from adhesion_jax.report.discovery.files import DISCOVERY_FILES
from experiments.campaigns.simulator import simulate


@pytest.fixture(scope="module")
def campaign():
    return simulate(["load_peak"], seed=2, base="exponential", **SIZE)


def written(folder, table, name="train.csv"):
    table.to_csv(folder / name, index=False)
    return str(folder / name)


def started(monkeypatch, out, *arguments):
    monkeypatch.setattr(sys, "argv", ["discover", *arguments, "--out", str(out)])
    run(main)


def refusal(arguments, out, capsys, monkeypatch):
    """What the command says where it must refuse: status 2, one line, and nothing is written."""
    with pytest.raises(SystemExit) as ended:
        started(monkeypatch, out, *arguments)
    assert ended.value.code == 2
    said = capsys.readouterr()
    # Nothing is printed but how the columns are understood, where that much can be said.
    first = said.out.split("\n")[0]
    assert first == "" or first.endswith(" are used.") or first == "Columns as understood so far:"
    # Progress is drawn and wiped by carriage returns.
    sentence = said.err.split("\r")[-1]
    assert sentence.startswith("error: ")
    assert sentence.endswith(".\n")
    assert said.err.count("\n") == 1
    assert "Traceback" not in said.err
    assert not out.exists() or not [*out.iterdir()]
    return sentence


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "Missing argument 'TRAIN...'"),
        (["TRAIN", "--correct"], "--correct is of the predictions of test data; name them by"),
        (["TRAIN", "--curve", "auto,pacejka"], "--curve pacejka is not known"),
        (["TRAIN", "--seed", "-1"], "--seed"),
        (["TRAIN", "--seed", "x"], "--seed"),
        (["TRAIN", "--depth", "3"], "--depth"),
        (["nowhere.csv"], "does not exist"),
        (["TRAIN", "--test", "nowhere.csv"], "does not exist"),
    ],
)
def test_what_makes_no_sense_is_refused(arguments, said, campaign, tmp_path, capsys, monkeypatch):
    train = written(tmp_path, campaign.train)
    arguments = [train if word == "TRAIN" else word for word in arguments]
    assert said in refusal(arguments, tmp_path / "out", capsys, monkeypatch)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda table: table.drop(columns="adhesion"), "adhesion"),
        (lambda table: table.drop(columns=["slip_ratio", "slip_velocity_mps"]), "slip_ratio"),
        (lambda table: table.assign(slip_ratio=np.nan), "no row has a value in slip_ratio."),
        (lambda table: table.head(3), "3 points"),
        (lambda table: table.assign(adhesion=-table["adhesion"]), "other sign"),
    ],
)
def test_data_that_cannot_be_used_are_refused(
    change, said, campaign, tmp_path, capsys, monkeypatch
):
    train = written(tmp_path, change(campaign.train))
    assert said in refusal([train], tmp_path / "out", capsys, monkeypatch)


def test_a_test_set_that_lacks_a_column_is_refused(campaign, tmp_path, capsys, monkeypatch):
    train = written(tmp_path, campaign.train)
    test = written(tmp_path, campaign.test.drop(columns="normal_load_N"), "test.csv")
    said = refusal([train, "--test", test], tmp_path / "out", capsys, monkeypatch)
    assert "The test data lack normal_load_N" in said


def test_a_folder_that_cannot_be_written_is_refused(campaign, tmp_path, capsys, monkeypatch):
    train = written(tmp_path, campaign.train)
    (tmp_path / "file").write_text("")
    said = refusal([train], tmp_path / "file" / "out", capsys, monkeypatch)
    assert "cannot be written to" in said


@pytest.fixture(scope="module")
def report(campaign, tmp_path_factory):
    """The folder of one run on odd columns, and what the run printed."""
    folder = tmp_path_factory.mktemp("discover")
    odd = {"note": "dry", "calibration": 7.5}
    paths = []
    for name in ("train", "test"):
        table = getattr(campaign, name)
        table = table.assign(**odd, load_in_kN=table["normal_load_N"])
        # The runs of the test set lie between each other.
        if name == "test":
            table = table.sort_values(["time_s", "run"], kind="stable", ignore_index=True)
            table["time_s"] = table.groupby("run")["time_s"].transform(np.sort)
        paths.append(written(folder, table, f"{name}.csv"))
    with pytest.MonkeyPatch.context() as patch:
        started(patch, folder / "out", paths[0], "--test", paths[1], "--seed", "3")
    return folder / "out", pd.read_csv(paths[1])


@pytest.mark.long
def test_every_file_is_written(report):
    found = {path.name for path in report[0].iterdir()}
    # The load moves the level of the curve and not its shape; the runs are not events of a log.
    assert found == {*DISCOVERY_FILES} - {"shapes.png", "events.png"}
    assert all((report[0] / name).stat().st_size > 100 for name in found)


@pytest.mark.long
def test_the_report_for_programs_has_its_keys(report, campaign):
    text = (report[0] / "report.json").read_text()
    assert "NaN" not in text
    told = json.loads(text)
    assert {"base", "noise_floor", "rmse", "effects", "unexplained", "warnings"} <= {*told}
    assert {*told["rmse"]} == {"train", "cross_validation", "test"}
    assert all({*error} == {"before", "after"} for error in told["rmse"].values())
    (effect,) = told["effects"]
    assert {*effect} == {"name", "candidates", "covariates", "parameters", "p_adjusted",
                         "rmse_after", "acts_on"}  # fmt: skip
    assert effect["acts_on"] == "level"
    assert all({*doubt} == {"names", "sentence"} for doubt in told["doubts"])
    assert effect["name"] == "load_peak"
    assert effect["covariates"] == ["normal_load_N"]
    power = effect["parameters"]["p"]
    assert {*power} == {"value", "low", "high", "unit"}
    truth = campaign.parameters["load_peak"]["p"]
    error = (power["high"] - power["low"]) / 3.92
    assert power["value"] == pytest.approx(truth, abs=3 * error)
    assert error < 0.1 * truth
    assert told["rmse"]["test"]["after"] < 1.05 * campaign.test_rms_noise


@pytest.mark.long
def test_odd_columns_are_warned_of(report):
    warnings = json.loads((report[0] / "report.json").read_text())["warnings"]
    assert "The column load_in_kN is left out: it is the same as normal_load_N." in warnings
    page = (report[0] / "report.md").read_text()
    assert "calibration" in page


@pytest.mark.long
def test_predictions_are_one_line_a_row_in_order(report):
    folder, test = report
    predictions = pd.read_csv(folder / "predictions.csv")
    measured = ["row", "run", "time_s", "slip", "adhesion"]
    assert [*predictions] == [*measured, "base", "corrected"]
    assert predictions["row"].tolist() == list(range(len(test)))
    for name, column in (("run", "run"), ("time_s", "time_s"), ("slip", "slip_ratio")):
        assert predictions[name].tolist() == test[column].tolist()
    told = json.loads((folder / "report.json").read_text())["rmse"]["test"]
    for column, when in (("base", "before"), ("corrected", "after")):
        error = predictions[column] - test["adhesion"]
        assert np.sqrt((error**2).mean()) == pytest.approx(told[when], rel=1e-6)


@pytest.mark.long
def test_the_law_that_was_written_is_that_of_the_predictions(report):
    folder, test = report
    law = load_law(folder / "law.json")
    rows = test[test["run"] == test["run"].iloc[-1]].sort_values("time_s")
    columns = {
        name: jnp.asarray(rows[name].to_numpy(float))
        for name in rows
        if name not in ("note", "run")
    }
    found = law(columns["slip_ratio"], columns)
    expected = pd.read_csv(folder / "predictions.csv")["corrected"][rows.index]
    np.testing.assert_allclose(found, expected, atol=1e-6)
