"""The generator of strangers keeps what it states, and its study counts what is reported."""

import json
from functools import cache, partial
from types import SimpleNamespace as Bare
from unittest.mock import Mock

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from scipy.interpolate import make_lsq_spline

from adhesion_jax.discovery.types import Findings, FoundEffect, Interval
from adhesion_jax.errors import InputError
from experiments import stranger_sets, strangers
from experiments.stranger_sets import (
    ACTING,
    BASES,
    EFFECTS,
    LABELS,
    NOISES,
    NUMBERS,
    STRENGTHS,
    TEST_RUNS,
    curve_of,
    stranger,
)

CAUSED = range(len(EFFECTS))  # one of each effect
SIZES = np.full(200, 100)


@cache
def made(number, null=False):
    return stranger(3, number, null)


def left(slip, values, rows):
    """What a cubic spline of slip, fitted to some of the rows, leaves of the values of the rest."""
    u = np.log1p(np.abs(slip) / 0.005)
    rest = np.zeros(values.size)
    for branch in (slip > 0, slip <= 0):
        if branch.any():
            fitted = np.nonzero(branch & rows)[0]
            order = fitted[np.argsort(u[fitted])]
            inner = np.quantile(u[order], np.linspace(0, 1, 16)[1:-1])
            ends = [u[branch].min()] * 4, [u[branch].max()] * 4
            curve = make_lsq_spline(u[order], values[order], np.r_[ends[0], inner, ends[1]], k=3)
            rest[branch] = values[branch] - curve(u[branch])
    return rest


def without_noise(*arguments):
    return 0 * arguments[-1]


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.mark.parametrize("null", [False, True])
def test_a_set_follows_from_seed_and_number_alone(null):
    first, other = stranger(3, 4, null), made(5, null)
    again = stranger(3, 4, null)
    pd.testing.assert_frame_equal(first.train, again.train)
    pd.testing.assert_frame_equal(first.test, again.test)
    np.testing.assert_array_equal(first.change, again.change)
    assert first[3:] == again[3:]
    assert not np.array_equal(first.train["adhesion"], other.train["adhesion"])
    assert not np.array_equal(first.train["adhesion"], stranger(4, 4, null).train["adhesion"])


@pytest.mark.parametrize("number", range(7))
def test_a_null_hides_nothing(number, monkeypatch):
    """Without noise and levels of runs its adhesion is one function of slip."""
    monkeypatch.setattr(stranger_sets, "_errors", without_noise)
    null = stranger(3, number, True)
    assert (null.strength, null.test_gap, null.causes, null.effect) == (0.0, 0.0, (), "nothing")
    if null.run_scatter == 0 and null.noise not in ("slip", "quantised"):
        both = pd.concat([null.train, null.test])
        slip, adhesion = both["slip_ratio"].to_numpy(), both["adhesion"].to_numpy()
        assert rms(left(slip, adhesion, slip != 0)) < 0.25 * null.sigma


@pytest.mark.long
def test_the_effect_is_as_strong_as_stated(monkeypatch):
    """Judged by another smoother, on adhesion without noise, over training and test rows."""
    monkeypatch.setattr(stranger_sets, "_errors", without_noise)
    checked = 0
    for number in range(40):
        one = stranger(3, number, False)
        if one.run_scatter or one.noise in ("slip", "quantised") or one.layout == "sweeps":
            continue
        both = pd.concat([one.train, one.test])
        rows = np.arange(len(both)) < len(one.train)
        rest = left(both["slip_ratio"].to_numpy(), both["adhesion"].to_numpy(), rows)
        assert rms(rest[rows]) == pytest.approx(one.strength * one.sigma, rel=0.1, abs=1e-4)
        assert rms(rest[~rows]) == pytest.approx(one.test_gap, rel=0.15, abs=3e-4)
        checked += 1
    assert checked >= 3


@pytest.mark.parametrize("number", CAUSED)
def test_columns_and_runs_are_as_promised(number):
    one = made(number)
    assert STRENGTHS[0] <= one.strength <= STRENGTHS[1] * 1.001
    both = pd.concat([one.train, one.test])
    assert not set(one.train["run"]) & set(one.test["run"])
    assert one.test["run"].nunique() == TEST_RUNS
    assert {*NUMBERS, "time_s", "position_m", "slip_ratio", "adhesion"} <= {*both}
    meaningless = [name for name in both if name.startswith("x")]
    assert 3 <= len(meaningless) <= 15
    numbers = both.drop(columns=["operator", "rail_id"], errors="ignore")
    assert np.isfinite(numbers.to_numpy(float)).all()
    assert (both.groupby("run")["time_s"].diff().dropna() > 0).all()
    if one.effect != "hysteresis":
        names = [name for cause in one.causes for name in cause]
        assert {*names} <= {*both} & {*ACTING, *LABELS, "x01"}
        assert all(len({*both[name]}) > 1 for name in names)
    if one.effect == "designed":
        cells = one.train.groupby("run")[[*NUMBERS[1:]]].nunique()
        assert (cells == 1).all(axis=None)
        assert len(one.train[[*NUMBERS[1:]]].drop_duplicates()) == 8


@pytest.mark.parametrize("base", BASES)
def test_curves_rise_from_zero_to_one_peak_and_fall(base):
    slip = np.linspace(0, 0.25, 2001)
    for seed in range(20):
        adhesion = curve_of(base, np.random.default_rng(seed))(slip)
        peak = adhesion.argmax()
        assert adhesion[0] == pytest.approx(0.0, abs=1e-3)
        assert 0.1 < adhesion[peak] < 0.5
        assert 0.01 < slip[peak] < 0.2
        assert (np.diff(adhesion[: peak + 1]) > -1e-9).all()
        assert (np.diff(adhesion[peak:]) < 1e-9).all()


@pytest.mark.parametrize("noise", NOISES)
def test_noise_has_the_size_and_correlation_that_its_name_says(noise):
    rng = np.random.default_rng(7)
    slip = rng.uniform(0.01, 0.1, SIZES.sum())
    errors = stranger_sets._errors(rng, noise, SIZES, slip)
    wanted = np.sqrt(1 + 0.02 * 10**2) if noise == "outliers" else 1.0
    assert errors.std() == pytest.approx(wanted, rel=0.06)
    runs = errors.reshape(-1, SIZES[0])
    rho = np.mean(runs[:, 1:] * runs[:, :-1]) / np.mean(runs**2)
    assert rho == pytest.approx({"AR .5": 0.5, "AR .9": 0.9}.get(noise, 0.0), abs=0.03)
    grown = np.abs(errors)[slip > 0.08].mean() / np.abs(errors)[slip < 0.03].mean()
    assert (grown > 1.5) == (noise == "grows with slip")


def effect_of(name, covariates=(), candidates=()):
    """A found effect of which no more than this is asked."""
    effect = Mock(spec=FoundEffect, covariates=covariates, candidates=candidates, p_adjusted=0.001)
    effect.name = name
    return effect


def finding(*effects, beside=None):
    """A discovery that reports exactly these effects, and removes half of the error.

    `beside` is the test error with trees on top.
    """

    def discover(train, test, seed, correct):
        assert (seed < 2, correct) == (True, True)  # the number of the set
        points = pd.DataFrame({"slip": train["slip_ratio"], "before": 0.2})
        findings = Mock(
            spec=Findings,
            effects=[effect_of(**effect) for effect in effects],
            unexplained=[],
            points=points,
            predictions=pd.DataFrame({"base": np.full(len(test), 0.2)}),
            validation=Bare(after=Interval(0.03, 0.028, 0.032)),
            test=Bare(before=Bare(value=0.05), after=Interval(0.05 / 2**0.5, 0.033, 0.038)),
            with_trees=None,
            beside_trees=beside and Bare(after=Bare(value=beside)),
            opinion=None,
        )
        return Bare(findings=findings)

    return Mock(side_effect=discover)


def reported(monkeypatch, *effects, beside=None):
    """The row of set 0 where exactly these effects are reported, and half of the error removed."""
    monkeypatch.setattr(strangers, "discover", finding(*effects, beside=beside))
    return strangers.one_set((3, 0, False))


@pytest.mark.long
def test_a_claim_is_right_where_it_names_the_column_alone_or_in_a_product(monkeypatch):
    (cause,) = made(0).causes
    columns = ("humming", *cause)
    right = reported(monkeypatch, {"name": "product:" + "*".join(columns), "covariates": ()})
    assert (right["named"], right["wrong beside"], right["claimed"]) == (1, False, True)
    both = reported(
        monkeypatch,
        {"name": "speed", "covariates": cause},
        {"name": "covariate:humming", "covariates": ("humming",)},
    )
    assert (both["named"], both["wrong beside"]) == (1, True)
    none = reported(monkeypatch)
    assert (none["named"], none["wrong beside"], none["claimed"]) == (0, False, False)
    noise = made(0).test_noise
    assert none["share"] == pytest.approx(0.5 * 0.05**2 / (0.05**2 - noise**2))
    assert not none["made worse"]
    # .0354 is .0054 above .0300: more than the root of .0020^2 + .0024^2.
    assert not none["error foretold"]
    assert strangers._foretold(Interval(0.03, 0.025, 0.035), Interval(0.0354, 0.033, 0.038))
    assert none["share corrected"] == none["share"]
    assert none["behind trees, untold"] == none["behind trees"]
    # The law's error is .035355; of its square .0099 and .0105 are removed.
    for beside, told in ((0.03518, False), (0.03517, True)):
        assert reported(monkeypatch, beside=beside)["trees told"] == told


@pytest.mark.long
def test_where_trees_are_ahead_and_the_report_says_so_it_is_told(monkeypatch):
    monkeypatch.setattr(strangers, "_peers_rms", lambda *_: (0.01, 0.1))
    for beside, untold in ((0.04, True), (0.02, False)):
        row = reported(monkeypatch, beside=beside)
        assert (row["behind trees"], row["behind trees, untold"]) == (True, untold)


def test_a_slope_is_covered_where_its_interval_holds_that_of_the_effect():
    draw = np.random.default_rng(2)
    train = pd.DataFrame(draw.normal([5.0, -2.0], [3.0, 0.5], (500, 2)), columns=["a", "b"])
    change = np.expm1(0.1 * (train["a"] - 5) / 3 - 0.2 * (train["b"] + 2) / 0.5)
    line = made(0)._replace(
        train=train.assign(adhesion=0.2),
        change=change.to_numpy(),
        effect="designed",
        causes=(("a",), ("b",)),
    )

    def slope(column, *interval, **more):
        effect = effect_of(f"covariate:{column}", (column,))
        effect.acts_on, effect.parameters = "level", {"k": Interval(0.0, *interval), **more}
        return effect

    # The slopes are those of the columns in units of their standard deviations.
    a, b = train["a"].std(ddof=0) / 3 * 0.1, -train["b"].std(ddof=0) / 0.5 * 0.2
    both = [slope("a", a - 1e-9, a + 1e-9), slope("b", b + 1e-6, 0.0)]
    assert strangers._sizes(line, both) == [True, False]
    assert strangers._sizes(line, [slope("c", -1, 1), slope("a", -1, 1, place=0.0)]) == []
    assert strangers._sizes(line._replace(effect="smooth level"), both) == []


def test_rates_and_shares_of_sets_counted_by_hand(monkeypatch):
    row = reported(monkeypatch)
    caused = pd.DataFrame([row | {"named": hit, "share": hit / 4} for hit in (1, 1, 0, 1)])
    nulls = pd.DataFrame(
        [row | {"causes": 0, "strength": 0.0, "claimed": n == 0} for n in range(50)]
    )
    sets = pd.concat([nulls, caused], ignore_index=True)
    table = strangers.rates(sets).set_index(["hidden", "group", "quantity"])
    claimed = table.loc[("nothing", "all", "claimed")]
    assert (claimed["count"], claimed["hits"]) == (50, 1)
    # Wilson by hand: (p + z^2/2n -+ z sqrt(p (1 - p)/n + z^2/4n^2))/(1 + z^2/n), z = 1.96.
    assert claimed["low"] == pytest.approx(0.00354, abs=1e-5)
    assert claimed["high"] == pytest.approx(0.10495, abs=1e-5)
    assert table.loc[("a cause", "all", "named"), "rate"] == 0.75
    removed = strangers.shares(sets).set_index(["group", "method"]).loc[("all", "discovery")]
    assert tuple(removed[["median", "quartile"]]) == (0.25, 0.1875)
    assert "claimed" in strangers.text(sets)


@pytest.mark.long
def test_a_study_that_is_resumed_computes_what_is_not_there(monkeypatch, tmp_path):
    out, discover = tmp_path / "out", finding({"name": "covariate:x01", "covariates": ("x01",)})
    monkeypatch.setattr(strangers, "discover", discover)
    asked = ["--nulls", "2", "--sets", "1", "--seed", "3", "--out", str(out)]
    run = partial(CliRunner().invoke, strangers.main, catch_exceptions=False)
    assert run(asked).exit_code == 0
    sets = pd.read_csv(out / "sets.csv")
    assert {file.name for file in out.iterdir()} == {*strangers.OWN_FILES, "shards"}
    assert (sets["claimed"].tolist(), sets["causes"].tolist()) == ([True] * 3, [0, 0, 1])
    (out / "shards" / "study-00001.parquet").unlink()
    assert run([*asked, "--resume"]).exit_code == 0
    assert discover.call_count == 4
    again = pd.read_csv(out / "sets.csv")
    assert json.loads((out / "metadata.json").read_text())["config"]["resumed"]
    times = ["seconds", "cpu_seconds"]
    pd.testing.assert_frame_equal(sets.drop(columns=times), again.drop(columns=times))
    with pytest.raises(InputError, match="--sets is 1 there and 2 here"):
        run([*asked, "--sets", "2", "--resume"])


def test_names_of_a_class_and_its_columns():
    effect = effect_of("covariate:x01", ("time_s",), ("product:a*b", "lag"))
    named = strangers.names_of(effect)
    assert {"x01", "a", "b", "lag", "time_s"} <= named
