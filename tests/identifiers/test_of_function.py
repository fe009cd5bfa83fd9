"""A method that is a function of NumPy and SciPy, which knows nothing of jax."""

import sys

import numpy as np
import pytest
from scipy.optimize import curve_fit

import adhesion_jax as adhesion
from adhesion_jax import plugins
from adhesion_jax.command_line.command import run
from adhesion_jax.command_line.program import adhesion as command


def burckhardt(slip, c1, c2, c3):
    return c1 * (1 - np.exp(-c2 * slip)) - c3 * slip


def least_squares(slip, adhesion):
    found, covariance = curve_fit(burckhardt, slip, adhesion, p0=(0.3, 30.0, 0.2))
    c1, c2, c3 = found
    slip_opt = np.log(c1 * c2 / c3) / c2
    peak = {"mu_max": burckhardt(slip_opt, *found), "slip_opt": slip_opt}
    return {"c1": c1, "c2": c2, "c3": c3, "c1_se": covariance[0, 0] ** 0.5, **peak}


def test_least_squares_by_scipy_are_those_of_the_package():
    asked = {"scipy": least_squares, "ml-exact": adhesion.IDENTIFIERS["ml-exact"]}
    found = adhesion.montecarlo("single", asked, runs=64)
    rows = found.estimates.set_index(["identifier", "run"])
    for name in ("c1", "mu_max", "slip_opt", "c1_se"):
        own, ours = rows.loc["scipy", name], rows.loc["ml-exact", name]
        np.testing.assert_allclose(own, ours, rtol=1e-3, err_msg=name)
    table = found.summary.set_index(["identifier", "quantity"]).loc["scipy"]
    assert (table["failure_share"] == 0).all()
    assert table.loc["c1", "coverage95"] > 0.8
    assert np.isnan(table.loc["mu_max", "coverage95"])  # it gives no error of that


def test_what_a_solver_does_not_find_is_a_failure_and_the_value_before_stays():
    def hasty(_, adhesion):
        if adhesion[7] > adhesion[8]:
            raise RuntimeError("Optimal parameters not found")
        return {"mu_max": 0.5, "slip_opt": np.nan}

    found = adhesion.montecarlo("single", {"hasty": hasty}, runs=128)
    failed = found.estimates["status"] == "not_finite"
    assert 0.1 < failed.mean() < 0.4
    assert found.summary["failure_share"].iloc[0] == pytest.approx(failed.mean())
    assert (found.estimates.loc[~failed, "mu_max"] == 0.5).all()
    start = found.estimates.loc[failed, "mu_max"]
    assert start.nunique() == 1
    assert start.iloc[0] != 0.5


@pytest.mark.parametrize(
    ("function", "words"),
    [
        (lambda _: {}, "raises TypeError"),
        (lambda *_: 0.3, "raises TypeError"),
        (lambda *_: {"peak": 0.3}, "raises KeyError"),
        (lambda *_: {"mu_max": np.nan}, "no finite mu_max"),
    ],
)
def test_what_gives_no_peak_is_refused_in_a_sentence(function, words):
    with pytest.raises(adhesion.InputError, match=words):
        adhesion.montecarlo("single", {"mine": function}, runs=2)


def test_a_function_takes_blocks_alone():
    with pytest.raises(adhesion.InputError, match="takes whole blocks"):
        adhesion.montecarlo("qian2024-switch", {"mine": least_squares}, runs=2)


OWN = """
import numpy as np
from adhesion_jax.identifiers.curve_fit import OfLastRecord

class Mine(OfLastRecord):
    FITS_LAST_RECORD = False

    def accepts(self, known):
        return None

    def update(self, state, record):
        return np.polyfit(np.asarray(record.slip), record.adhesion, 2)

def fit(slip, adhesion):
    return {"mu_max": np.quantile(adhesion, 0.95), "slip_opt": 0.1}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    home = tmp_path_factory.mktemp("own")
    (home / "mine.py").write_text(OWN)
    return home


@pytest.fixture
def status(folder, monkeypatch, capsys):
    """The status of a Monte Carlo command with a part of the file above, and what it says."""
    monkeypatch.chdir(folder)
    monkeypatch.setattr(plugins, "_used", {})

    def of(name, *words):
        asked = ["--scenario", "single", "--identifiers", f"mine.py:{name}", *words]
        monkeypatch.setattr(sys, "argv", ["adhesion", "montecarlo", *asked])
        try:
            run(command)
            return 0, capsys.readouterr().out
        except SystemExit as ended:
            return ended.code, capsys.readouterr().err

    yield of
    for name in ("Mine", "fit"):
        adhesion.IDENTIFIERS.pop(name, None)


def test_a_function_in_a_file_is_a_method(status):
    code, said = status("fit", "--runs", "20")
    assert code == 0
    assert "fit" in said


@pytest.mark.parametrize("runs", [20, pytest.param(600, marks=pytest.mark.slow)])
def test_a_class_that_calls_numpy_is_refused_in_a_sentence(runs, status):
    # With 600 runs that happens in worker processes.
    code, said = status("Mine", "--runs", str(runs), "--workers", "2")
    assert code == 2
    assert said.count("\n") == 1
    assert "mine.py, line 12: TracerArrayConversionError" in said
    assert "jax.pure_callback" in said
    assert "a function of slip and adhesion" in said
