"""Methods of NumPy and SciPy, which know nothing of jax: functions of a block, and classes."""

import sys

import numpy as np
import pytest
from lanes import lanes
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


@pytest.mark.long
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


class Recursive:
    """Recursive least squares with forgetting, as `rls-kiencke`."""

    def __init__(self, a0=40.0):
        self.a0 = a0

    def init(self):
        return {"x": np.array([100.0, 50.0]), "p": 1e10 * np.eye(2), "samples": 0}

    def update(self, state, slip, adhesion):
        x, p = state["x"], state["p"]
        u = np.array([slip * adhesion, slip**2 * adhesion])
        gain = p @ u / (0.99 + u @ p @ u)
        x = x + gain * (self.a0 * slip - adhesion - u @ x)
        p = (p - np.outer(gain, u @ p)) / 0.99
        return {"x": x, "p": p, "samples": state["samples"] + 1}

    def estimate(self, state):
        assert isinstance(state["samples"], int)
        p1, p2 = state["x"]
        if p2 < 1:
            raise ValueError("no peak")
        return {"mu_max": self.a0 / (p1 + 2 * p2**0.5), "slip_opt": p2**-0.5, "p1": p1}


@pytest.mark.parametrize(
    "scenario", lanes(["qian2024-switch", "qian2024"], always=0, long=1, thorough=1)
)
def test_a_class_follows_samples_as_a_recursion_of_the_package_does(scenario):
    asked = {"mine": Recursive, "rls-kiencke": adhesion.IDENTIFIERS["rls-kiencke"]}
    found = adhesion.montecarlo(scenario, asked, runs=2, points=100)
    rows = found.estimates.set_index(["identifier", "run", "block"])
    own, ours = rows.loc["mine"], rows.loc["rls-kiencke"]
    right = ours["status"].eq("trusted").to_numpy()
    assert right.mean() > 0.5
    for name in ("mu_max", "slip_opt", "p1"):
        np.testing.assert_allclose(own[name][right], ours[name][right], rtol=1e-4)
    assert "Slow, because it is called in Python: mine" in repr(found)


def test_a_class_follows_a_loop_too():
    online, samples = adhesion.online({"mine": Recursive(a0=40.0)}, a0=40.0), Recursive()
    state = samples.init()
    for slip, mu in [(0.02, 0.45), (0.05, 0.65), (np.nan, 0.6), (0.1, 0.77), (0.15, 0.7)]:
        now = online.update(slip, mu)
        if np.isfinite(slip):
            state = samples.update(state, slip, mu)
    assert now.mu_max == pytest.approx(samples.estimate(state)["mu_max"], rel=1e-12)


class Few:
    """The mean of all adhesions so far, of ten samples or more."""

    def init(self):
        return np.zeros(2)

    def update(self, state, slip, adhesion):
        if adhesion < 0:
            raise ValueError("it brakes")
        return state + np.array([1, adhesion])

    def estimate(self, state):
        if state[0] < 10:
            raise ValueError("too few samples")
        return {"mu_max": state[1] / state[0], "slip_opt": 0.1}


def test_samples_of_which_nothing_can_be_told_yet_are_not_lost():
    online = adhesion.online({"few": Few}, a0=40.0)
    told = [online.update(0.1, mu) for mu in (0.1, 0.2, -0.3, 0.3, *[0.4] * 6, 0.5)]
    assert [one.status.name for one in told] == ["NOT_FINITE"] * 10 + ["TRUSTED"]
    assert told[-1].mu_max == pytest.approx((0.1 + 0.2 + 0.3 + 6 * 0.4 + 0.5) / 10, rel=1e-12)


def test_a_state_that_begins_whole_need_not_stay_so():
    class Mean:
        def init(self):
            return [0, 0, np.zeros(2, int)]

        def update(self, state, slip, adhesion):
            return [state[0] + 1, state[1] + adhesion, state[2] + slip]

        def estimate(self, state):
            return {"mu_max": state[1] / state[0], "slip_opt": state[2][1] / state[0]}

    online = adhesion.online({"mean": Mean}, a0=40.0)
    online.update(0.1, 0.5)
    assert online.update(0.2, 0.25)[:2] == pytest.approx((0.375, 0.15))


def wrong(**parts):
    """A class that is right but for these of its functions; None takes one away."""
    found = {**vars(Recursive), **parts}
    return type("Wrong", (), {name: part for name, part in found.items() if part is not None})


@pytest.mark.parametrize(
    ("method", "words"),
    [
        (wrong(estimate=None), "it lacks estimate"),
        (wrong(__init__=lambda _, __: None), "missing 1 required positional argument"),
        (wrong(init=lambda _: object()), "raises TypeError"),
        (wrong(update=lambda _, state: state), "raises TypeError.*takes 2 positional"),
        (wrong(update=lambda *_: [1.0]), "update gives a state of another form than init"),
        (wrong(estimate=lambda *_: 0.3), "raises TypeError"),
        (wrong(estimate=lambda *_: {"peak": 0.3}), "raises KeyError"),
        (wrong(estimate=lambda *_: {"mu_max": np.inf}), "no finite mu_max"),
    ],
)
def test_a_class_that_is_no_method_is_refused_in_a_sentence(method, words):
    with pytest.raises(adhesion.InputError, match=words) as refusal:
        adhesion.montecarlo("qian2024-switch", {"mine": method}, runs=2)
    assert "\n" not in str(refusal.value)


def late(slip, _):
    if slip.size == 500:  # as no block of the trial has
        raise KeyError("what")
    return {"mu_max": 0.5}


@pytest.mark.long
def test_what_goes_wrong_in_a_run_is_told_with_its_line_and_without_a_page_of_traceback(capfd):
    with pytest.raises(adhesion.InputError) as refusal:
        adhesion.montecarlo("single", {"mine": late}, runs=2)
    words = str(refusal.value)
    assert words.startswith("mine cannot be used as a method: it raises KeyError in line ")
    assert "test_of_numpy.py ('what')" in words
    assert "Traceback" not in capfd.readouterr().err
    found = adhesion.montecarlo("single", {"mine": late}, runs=2, points=400)  # the fault is gone
    assert (found.estimates["mu_max"] == 0.5).all()


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
