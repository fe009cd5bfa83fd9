"""The functions of the library, from data frames to results."""

import json
import subprocess
import sys
from pathlib import Path
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest

import adhesion_jax as aj
from adhesion_jax import library
from adhesion_jax.data import to_runs
from adhesion_jax.identifiers.riv import RefinedInstruments
from adhesion_jax.library.reading import measured_of
from adhesion_jax.report.measured.words import answer_lines

FRAME = pd.read_csv(aj.SHIPPED["eurosprinter"].path)
RIG = pd.read_csv(aj.SHIPPED["roller-rig"].path)
CURVES = ["kiencke", "polach"]


@pytest.fixture(scope="module")
def found():
    return aj.identify(FRAME, CURVES)


@pytest.fixture(scope="module")
def missing():
    return aj.discover(RIG)


class Mine(RefinedInstruments):
    """A method of one's own."""

    RESETS: ClassVar[bool] = True


def test_every_name_that_is_exported_is_there():
    assert set(aj.__all__) <= set(dir(aj))
    for name in aj.__all__:
        assert getattr(aj, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        aj.nonsense  # noqa: B018
    source = Path(aj.__file__).with_suffix(".pyi").read_text()
    assert all(f"import {name} as {name}" in source for name in aj.__all__)


def test_what_an_identification_tells(found):
    assert found.best == "kiencke"
    assert list(found.fits) == CURVES
    assert list(found.table["curve"]) == CURVES
    row = found.table.set_index("curve").loc["kiencke"]
    # The answer by all curves is wider than that of the best, which lies within it.
    low, high = found.mu_max_interval
    assert low < row["mu_max_lo"] < found.mu_max < row["mu_max_hi"] < high
    low, high = found.slip_opt_interval
    assert low < found.slip_opt < high
    peak = found.fit.peak
    assert found.curve(jnp.asarray(peak.slip), found.conditions) == pytest.approx(peak.adhesion)
    assert "mu_max    0.30" in repr(found)
    assert "the data frame has 163 points" in found.verdict
    assert "kiencke" in repr(found)
    assert "<table" in found._repr_html_()
    assert "Data: the data frame" in found._repr_html_()


def test_the_parameters_of_each_curve_with_their_errors(found):
    table = found.parameters.set_index(["curve", "parameter"])
    for name, fit in found.fits.items():
        for place, parameter in enumerate(fit.curve.free):
            row = table.loc[(name, parameter)]
            assert row["value"] == fit.parameters[place]
            np.testing.assert_equal(row["se"], fit.standard_errors[place])
            assert row["unit"] == fit.curve.PARAMETERS[parameter].unit
    assert [*found.params] == ["a0", "p1", "p2"]
    for name, one in found.params.items():
        assert tuple(one) == tuple(table.loc[("kiencke", name), ["value", "se"]])
    # In short: the peak, the best curve, and a line for each of its parameters.
    told = found.report()
    assert told.startswith(f"{answer_lines(found)}\nkiencke: rms ")
    assert [line.split()[0] for line in told.splitlines()[-3:]] == ["a0", "p1", "p2"]
    assert repr(found.fit).startswith("<Kiencke fitted to 163 points: largest adhesion 0.30")


@pytest.mark.long
def test_the_curve_has_the_peak_of_the_table_and_is_kept(found, tmp_path):
    row = found.table.set_index("curve").loc[found.best]
    peak = found.curve.peak(found.conditions)
    assert peak.adhesion == pytest.approx(row["mu_max"], rel=1e-9)
    assert peak.slip == pytest.approx(row["slip_opt"], rel=1e-6)
    assert "np.float64" not in repr(found.curve)
    assert found.curve(0.02) == found.curve(0.02, {})  # Kiencke's needs the slip alone
    for curve in (found.curve, found.fit.curve, aj.Kiencke(a0=40.0, p1=31.3, p2=100.0)):
        aj.save_law(tmp_path / "law.json", curve)
        slips = jnp.linspace(-0.1, 0.2, 7)
        again = aj.load_law(tmp_path / "law.json")(slips, found.conditions)
        np.testing.assert_array_equal(again, curve(slips, found.conditions))


def test_arrays_by_their_names_are_data(found):
    columns = {name: FRAME[name].to_numpy() for name in FRAME}
    pd.testing.assert_frame_equal(aj.identify(columns, CURVES).table, found.table)
    lists = {name: [*values] for name, values in columns.items()}
    pd.testing.assert_frame_equal(measured_of(lists).table, measured_of(FRAME).table)
    with pytest.raises(
        aj.InputError,
        match=r"The columns make no table .* give arrays of one dimension and one len",
    ):
        aj.identify({"slip_ratio": [0.1, 0.2], "adhesion": [0.1]})


@pytest.mark.long
def test_a_notebook_shows_what_is_drawn(found, missing):
    followed = aj.track(FRAME, "rls-kiencke")
    for result in (found, followed, aj.plan("common"), missing):
        figure = result.plot()
        assert figure._repr_png_().startswith(b"\x89PNG")
        assert len(figure.axes) >= 1


def test_a_frame_says_what_its_file_says(found):
    from_file = aj.identify(aj.SHIPPED["eurosprinter"].path, CURVES)
    pd.testing.assert_frame_equal(found.table, from_file.table)
    # Neither an index nor the kind of the numbers is part of the measurement.
    odd = FRAME.assign(**{"Unnamed: 0": 1.0, "adhesion": FRAME["adhesion"].astype(str)})
    odd = odd.set_index(np.arange(len(FRAME))[::-1])
    pd.testing.assert_frame_equal(found.table, aj.identify(odd, CURVES).table)


def test_columns_are_told_as_the_command_is_told():
    shown = pd.DataFrame(
        {
            "v": 3.6 * FRAME["vehicle_speed_mps"],
            "Schlupf": 100 * FRAME["slip_ratio"],
            "F [kN]": 1e-3 * FRAME["adhesion"] * FRAME["normal_load_N"],
            "Radlast [kN]": 1e-3 * FRAME["normal_load_N"],
        }
    )
    said = {"speed": "v [km/h]", "slip": "Schlupf [%]", "wheel_force": "F [kN]"}
    measured = measured_of(shown, said)
    for name in ("slip_ratio", "adhesion", "normal_load_N", "vehicle_speed_mps"):
        np.testing.assert_allclose(measured.table[name], FRAME[name], rtol=1e-12)
    assert measured.understood["column"].tolist()[:4] == [*shown]
    # The answers are those of a function, not of the command.
    asked = r'column Schlupf is a ratio or in per cent \(columns=\{"slip": "Schlupf \[1\]"\} or'
    with pytest.raises(aj.InputError, match=asked):
        aj.identify(shown, columns={name: said[name] for name in ("speed", "wheel_force")})
    with pytest.raises(aj.InputError, match=r"whether column F .kN. is the wheel force"):
        aj.discover(shown, columns={name: said[name] for name in ("speed", "slip")})


@pytest.mark.thorough
def test_points_without_a_peak_have_an_answer_in_words():
    slip = 0.1 * np.abs(np.sin(np.arange(2000) / 40)) + 1e-3
    noise = np.random.default_rng(0).normal(0, 0.005, slip.size)
    frame = pd.DataFrame({"slip_ratio": slip, "adhesion": 0.3 * slip / (0.02 + slip) + noise})
    found = aj.identify(frame, "kiencke")
    reached = 0.3 * slip.max() / (0.02 + slip.max())
    assert found.mu_max == pytest.approx(reached, abs=0.002)
    assert found.mu_max_interval[1] == np.inf
    assert np.isnan(found.slip_opt)
    assert f"at least {found.mu_max:.4f}" in repr(found)


def test_a_curve_by_a_name_of_ones_own(found):
    own = aj.identify(FRAME, {"mine": aj.CURVES["kiencke"]})
    assert own.best == "mine"
    assert own.fit.peak.adhesion == found.fit.peak.adhesion
    # Alone it has all the weight: the answer is its own interval.
    row = own.table.iloc[0]
    assert own.mu_max_interval == pytest.approx((row["mu_max_lo"], row["mu_max_hi"]), abs=1e-7)


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (FRAME.drop(columns="adhesion"), "the data frame cannot be used: the column adhesion"),
        (FRAME.assign(slip_ratio=7.0), "a tenth of the slips of column slip_ratio exceed 1.5"),
        (pd.concat([FRAME, FRAME["adhesion"]], axis=1), "has the column adhesion twice"),
        (FRAME[:3], "there are 3 points"),
        ("nowhere.csv", "nowhere.csv does not exist"),
        ({"slip_ratio": np.ones((2, 9)), "adhesion": np.ones((2, 9))}, "arrays of one dimension"),
    ],
)
def test_data_that_cannot_be_used_are_refused_in_a_sentence(data, says):
    for function in (aj.identify, aj.discover):
        with pytest.raises(aj.InputError, match=says):
            function(data)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"scenario": "nowhere"}, "There is no scenario nowhere; the scenarios are single"),
        ({"identifiers": "nothing"}, "There is no identifier nothing"),
        ({"identifiers": [np.hypot, "riv"]}, "There is no identifier hypot; .* by name"),
        ({"identifiers": {"riv": Mine(2.0, 0.02, 0.1)}}, "riv is the name of a method of"),
        ({"identifiers": ["riv"]}, "riv cannot be run on single: it is written for Kiencke"),
        ({"runs": 0}, "runs are from 1 to 1,000,000,000"),
        ({"runs": 10**20}, "runs are from 1 to"),
        ({"seed": -1}, "a seed is from 0"),
        ({"resume": True}, "the job in a folder; name it as out"),
        ({"extend": 5}, "the job in a folder; name it as out"),
        ({"cluster": "local:2"}, "for a job in a folder; name it as out"),
        (
            {"colour": "red"},
            "--colour does not go with --scenario single, which takes --rail, --truth",
        ),
        ({"rail": "icy"}, "icy is unknown; the rails are dry"),
        ({"points": 3}, "points is a whole number from 4 to 1e[+]06, not 3"),
        ({"points": 99.5}, "points is a whole number"),
        ({"sigma": float("nan")}, "sigma is a number from 0 to 10, not nan"),
        ({"sigma": "much"}, "sigma is a number from 0 to 10, not 'much'"),
    ],
)
def test_a_campaign_that_cannot_be_is_refused_in_a_sentence(arguments, says):
    with pytest.raises(aj.InputError, match=says):
        aj.montecarlo(**arguments)


#: In a process of its own, for in this one types are checked.
UNFIT = """
import adhesion_jax as aj
for asked in ({"runs": 2.9}, {"seed": 1.7}, {"keep": "some"}):
    try:
        aj.montecarlo("single", ["ml-exact"], **asked)
    except aj.InputError as refusal:
        print(refusal)
"""


def test_numbers_that_are_not_whole_and_a_keep_that_is_none_are_refused():
    done = subprocess.run(
        [sys.executable, "-c", UNFIT], capture_output=True, text=True, check=False
    )
    runs, seed, keep = done.stdout.splitlines()
    assert "whole numbers" in runs
    assert "whole numbers" in seed
    assert keep == "keep is checkpoints or all, not 'some'."


@pytest.mark.long
def test_a_method_of_ones_own_among_others():
    result = aj.montecarlo(
        "qian2024",
        {"mine": Mine(2.0, 0.02, 0.1), "riv": aj.IDENTIFIERS["riv"]},
        runs=30,
        points=100,
    )
    assert set(result.tables) >= {"summary"}
    assert set(result.summary["identifier"]) == {"mine", "riv"}
    of = dict(list(result.estimates.groupby("identifier")))
    assert set(of["mine"]["run"]) == set(range(30))
    # It is the method it is derived from, on the same noise.
    np.testing.assert_array_equal(of["mine"]["mu_max"], of["riv"]["mu_max"])
    assert "<table" in result._repr_html_()
    assert "mine" in repr(result)
    assert len(result.tables["checkpoints"]) > len(result.summary) / 2
    (title,) = (axis.get_title() for axis in result.plot().axes)
    assert title.startswith("dry rail\na row is as high as a density of ")


@pytest.mark.thorough
def test_what_a_discovery_tells(missing, tmp_path):
    assert "lateral creep" in missing.verdict
    effects = missing.effects
    assert set(effects["effect"]) == {"lateral_creep"}
    assert ((effects["lo"] < effects["value"]) & (effects["value"] < effects["hi"])).all()
    assert list(missing.errors["data"]) == ["training", "cross-validation"]
    assert (missing.errors["after"] < missing.errors["before"]).all()
    assert missing.predictions is None
    assert len(missing.points) == len(RIG)
    assert list(missing.ranking.columns) == list(type(missing.findings.ranking[0])._fields)
    assert missing.findings.source == "the data frame"
    assert "removes" in repr(missing)
    assert missing._repr_html_().count("<table") == 2

    conditions = {"lateral_creepage": 0.01, "angle_of_attack_deg": 0.5}
    aj.save_law(str(tmp_path / "law.json"), missing.law)
    again = aj.load_law(str(tmp_path / "law.json"))
    slip = jnp.asarray(0.02)
    assert again(slip, conditions) == missing.law(slip, conditions)
    assert jax.jit(missing.law)(slip, conditions) == pytest.approx(float(again(slip, conditions)))

    missing.write(tmp_path / "report")
    assert json.loads((tmp_path / "report" / "report.json").read_text())["effects"]


@pytest.mark.thorough
def test_several_tables_and_a_test():
    """Runs of a table are told apart from runs of the same name in another one."""
    halves = [RIG[:20].assign(run=1), RIG[20:].assign(run=1)]
    runs = to_runs(library.reading.all_of(halves))
    assert runs.names == ("table 1:1", "table 2:1")
    assert to_runs(library.reading.all_of(RIG)).names == ("1",)
    judged = aj.discover(RIG, RIG)
    on_the_test = ["test", "test, trees for comparison"]
    assert list(judged.errors["data"]) == ["training", "cross-validation", *on_the_test]
    assert len(judged.predictions) == len(RIG)


def test_a_sample_is_one_point_or_a_block():
    one = aj.sample(0.02, 0.3, time_s=1.5)
    assert one.slip.shape == one.mask.shape == one.conditions["time_s"].shape == (1,)
    assert bool(one.fresh.all())
    block = aj.sample(jnp.linspace(0.0, 0.1, 5), jnp.zeros(5), vehicle_speed_mps=20.0)
    assert block.conditions["vehicle_speed_mps"].shape == (5,)
    with jax.enable_x64(False), pytest.raises(aj.InputError, match="needs double precision"):
        aj.sample(0.02, 0.3)


_HOST = """
import importlib, json, os, pkgutil, sys, threading, warnings
import adhesion_jax as aj
assert not {"jax", "pandas", "numpy"} & set(sys.modules), "importing it imports others"
warnings.simplefilter("error")
warnings.filterwarnings("ignore", message="JAXopt")
import jax, jax.numpy as jnp
# Packages that set variables of their own when they are imported.
import matplotlib, pandas, pint, sklearn.ensemble, threadpoolctl
before = dict(os.environ), dict(jax.config.values)
for name in aj.__all__:
    getattr(aj, name)
for room in pkgutil.walk_packages(aj.__path__, "adhesion_jax."):
    if "command_line" not in room.name and "__main__" not in room.name:
        importlib.import_module(room.name)
assert not jax._src.xla_bridge._backends, "importing opens a device"
found = aj.identify("eurosprinter", "kiencke")
result = aj.montecarlo("single", "ml-exact", runs=20, points=60)
missing = aj.discover("roller-rig")
repr(found), repr(result), repr(missing), found._repr_html_(), missing._repr_html_()
assert (dict(os.environ), dict(jax.config.values)) == before, "settings were changed"
kinds = [jnp.ones(2).dtype.name, jax.jit(lambda x: 2.0 * x)(1.0).dtype.name]
thread = threading.Thread(target=lambda: kinds.append(jnp.ones(2).dtype.name))
thread.start(); thread.join()
assert set(kinds) == {"float32"}, kinds
assert found.curve(0.02, {}).dtype.name == "float64", "a fitted curve is less precise than its fit"
for function in (aj.identify, aj.discover):
    try:
        function(pandas.DataFrame({"x": [1.0]}).to_numpy())
    except aj.InputError as error:
        assert "or the path of a file, not ndarray" in str(error)
    else:
        raise AssertionError("an array was taken for a table")
print(json.dumps({
    "mu_max": found.mu_max, "slip_opt": found.slip_opt, "rms": found.fit.rms,
    "rmse": result.summary["rmse"].tolist(), "bound": result.summary["crlb"].tolist(),
    "after": missing.errors["after"].tolist(),
}))
"""


@pytest.mark.thorough
def test_a_program_of_single_precision_is_left_as_it_is_and_gets_the_same_numbers(found, missing):
    done = subprocess.run(
        [sys.executable, "-c", _HOST], capture_output=True, text=True, timeout=500, check=False
    )
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    by_one = aj.identify("eurosprinter", "kiencke")
    assert told["mu_max"] == pytest.approx(by_one.mu_max, rel=1e-9)
    assert told["slip_opt"] == pytest.approx(by_one.slip_opt, rel=1e-9)
    assert told["rms"] == pytest.approx(found.fits["kiencke"].rms, rel=1e-9)
    # The answer by a single curve is the peak of that curve; its slip is read from a fine grid.
    peak = found.fits["kiencke"].peak
    assert told["mu_max"] == pytest.approx(float(peak.adhesion), rel=1e-9)
    assert told["slip_opt"] == pytest.approx(float(peak.slip), rel=1e-6)
    assert told["after"] == pytest.approx(missing.errors["after"].tolist(), rel=1e-9)
    here = aj.montecarlo("single", "ml-exact", runs=20, points=60).summary
    assert told["rmse"] == pytest.approx(here["rmse"].tolist(), rel=1e-9)
    assert told["bound"] == pytest.approx(here["crlb"].tolist(), rel=1e-9)
