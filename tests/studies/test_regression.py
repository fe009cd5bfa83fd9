"""The regression benchmark: what it must notice, and what it must not."""

import os
import pickle
from pathlib import Path
from types import SimpleNamespace
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from adhesion_jax.campaign.tiles import Tiles
from adhesion_jax.errors import InputError
from adhesion_jax.identifiers import IDENTIFIERS, Identifier
from experiments.regression import __main__ as regression
from experiments.regression import compare as comparison
from experiments.regression import measuring
from experiments.regression.__main__ import TURNS, TURNS_AGAIN, main
from experiments.regression.compare import (
    compare,
    faster_of,
    holm,
    moved_text,
    p_values,
    share_p,
    suspects,
)
from experiments.regression.measuring import HOMES, homes, measure_accuracy, measure_speed
from experiments.regression.table import ACCURACY, COLUMNS, KEYS, assemble, read_baseline

NAME = "ml-exact"
BASELINE = Path(__file__).parents[2] / "results" / "baseline.csv"
RUNS = 128  # one tile: in this process, no workers


class Wrapped(Identifier):
    """A method in the place of another."""

    FITS_LAST_RECORD: ClassVar[bool] = True
    RESETS: ClassVar[bool] = False

    inner: Identifier

    def accepts(self, known):
        return self.inner.accepts(known)

    def init(self, known, key):
        return self.inner.init(known, key)

    def update(self, state, record):
        return self.inner.update(state, record)

    def estimate(self, state):
        return self.inner.estimate(state)


class Biased(Wrapped):
    mu_max: float = 0.0
    c3: float = 0.0

    def estimate(self, state):
        found = self.inner.estimate(state)
        values = dict(found.values)
        for quantity, share in (("mu_max", self.mu_max), ("c3", self.c3)):
            values[quantity] = values[quantity] * (1 + share)
        return found._replace(values=values)


class Slowed(Wrapped):
    """Does its update three times, each on data that depend on the result before.

    The estimate and its tracking are timed too and are done once, so that twice the update would
    take only 1.7 times as long, and three times takes somewhat more than twice as long.
    """

    def update(self, state, record):
        def work(_, found):
            nothing = 0.0 * jnp.nan_to_num(self.inner.estimate(found).objective)
            return self.inner.update(state, record._replace(adhesion=record.adhesion + nothing))

        return jax.lax.fori_loop(0, 3, work, state)


def measured(seed, method=None):
    identifiers = {NAME: method or IDENTIFIERS[NAME]}
    table = measure_accuracy(identifiers, RUNS, seed, lambda _: None)
    return table.reindex(columns=list(COLUMNS))


def timed(method, turns=TURNS):
    return measure_speed({NAME: method}, turns, lambda _: None)


@pytest.fixture(scope="module")
def accuracy():
    return measured(0)


@pytest.fixture(scope="module")
def baseline(accuracy):
    """With a speed as a clock might have told it."""
    return assemble(accuracy, speeds(40.0))


@pytest.fixture(scope="module")
def timed_baseline(accuracy):
    return assemble(accuracy, timed(IDENTIFIERS[NAME]))


def speeds(speed):
    return pd.DataFrame(
        {
            "scenario": HOMES[0].scenario,
            "identifier": NAME,
            "rail": "",
            "quantity": "speed",
            "speed": [speed],
            "speed_spread": 0.1,
        }
    )


def verdicts(compared):
    rows = compared[compared["verdict"] != "same"]
    return {
        tuple(row): verdict for *row, verdict in rows[[*KEYS[2:], "statistic", "verdict"]].values
    }


def without_speed(baseline):
    return baseline[baseline["quantity"] != "speed"]


@pytest.mark.thorough
def test_the_same_method_on_other_noise_has_not_moved(baseline):
    compared = compare(without_speed(baseline), measured(1))
    # Three rails of five quantities by bias, rmse and coverage; a failure share a rail.
    assert len(compared) == 3 * 5 * 3 + 3
    assert verdicts(compared) == {}


@pytest.mark.thorough
@pytest.mark.parametrize("quantity", ["mu_max", "c3"])
def test_a_planted_bias_of_five_per_cent_is_caught(baseline, quantity):
    compared = compare(
        without_speed(baseline), measured(1, Biased(IDENTIFIERS[NAME], **{quantity: 0.05}))
    )
    found = verdicts(compared)
    assert found[("dry", quantity, "bias")] == "moved"
    assert found[("dry", quantity, "rmse")] == "worse"
    assert all(moved == quantity for _, moved, _ in found)  # and nothing else is accused
    assert quantity in moved_text(compared)


@pytest.mark.clock
def test_a_planted_slowdown_by_two_is_caught_and_a_second_timing_does_not_excuse_it(
    accuracy, timed_baseline
):
    slow = assemble(accuracy, timed(Slowed(IDENTIFIERS[NAME])))
    compared = compare(timed_baseline, slow)
    assert suspects(compared) == (NAME,)
    again = faster_of(slow, timed(Slowed(IDENTIFIERS[NAME]), TURNS_AGAIN))
    assert verdicts(compare(timed_baseline, again)) == {("", "speed", "speed"): "worse"}


@pytest.mark.clock
def test_a_slow_turn_of_the_machine_is_no_slowdown(timed_baseline):
    slow = timed_baseline.copy()
    slow["speed"] /= 2
    assert suspects(compare(timed_baseline, slow)) == (NAME,)
    again = faster_of(slow, timed(IDENTIFIERS[NAME]))
    assert verdicts(compare(timed_baseline, again)) == {}


@pytest.mark.thorough
def test_a_speed_is_judged_by_the_faster_of_its_timings(baseline, accuracy):
    """Two thirds of the baseline's is the limit; no clock is asked."""
    for speed, suspected in ((26.0, (NAME,)), (27.5, ()), (80.0, ())):
        now = assemble(accuracy, speeds(speed))
        assert suspects(compare(baseline, now)) == suspected
    slow = assemble(accuracy, speeds(20.0))
    for again, verdict in ((18.0, {("", "speed", "speed"): "worse"}), (39.0, {})):
        assert verdicts(compare(baseline, faster_of(slow, speeds(again)))) == verdict


@pytest.mark.long
def test_speed_is_a_ratio_to_the_work_of_the_peer(monkeypatch):
    """By clocks that are known: the median of the turns but the first, which compiles."""
    turn = iter([9.0, 1.0, 2.0, 4.0])
    seconds = []

    def identify(*_):
        return SimpleNamespace(seconds=seconds[-1])

    def peer():
        if peer.asked % 6 == 0:  # three times before a method and three times after it
            seconds.append(next(turn))
        peer.asked += 1
        return 0.5

    peer.asked = 0
    monkeypatch.setattr(Tiles, "identify", identify)
    monkeypatch.setattr(measuring, "peer_seconds", peer)
    (row,) = measure_speed({NAME: IDENTIFIERS[NAME]}, 3, lambda _: None).to_dict("records")
    # A tile has 128 runs: 64, 32 and 16 of them while the peer does its work.
    assert row["speed"] == pytest.approx(32.0)
    assert row["speed_spread"] == pytest.approx((48 - 24) / 2)


def drawn(random, runs, rows):
    """A table of `rows` identifiers from runs as ill-behaved as can be, nothing changed."""
    kind = np.arange(rows)[:, None] % 4
    normal = random.normal(size=(rows, runs))
    rare = random.random((rows, runs)) < 0.003  # three runs in a thousand go astray
    error = np.select(
        [kind == 0, kind == 1, kind == 2],
        [normal, np.exp(2 * normal), np.where(rare, 1e3, 1e-3 * normal)],
        np.sign(normal) * np.exp(1.5 * np.abs(normal)),
    )
    square = error**2
    shares = {
        "coverage95": (random.random((rows, runs)) < 0.95).mean(axis=1),
        "failure_share": rare.mean(axis=1),
    }
    rmse = np.sqrt(square.mean(axis=1))
    table = pd.DataFrame(
        {
            "scenario": "drawn",
            "identifier": [f"method-{i}" for i in range(rows)],
            "rail": "dry",
            "quantity": "mu_max",
            "bias": error.mean(axis=1),
            "bias_se": error.std(axis=1, ddof=1) / np.sqrt(runs),
            "rmse": rmse,
            "rmse_se": square.std(axis=1, ddof=1) / np.sqrt(runs) / (2 * rmse),
            **shares,
            **{f"{name}_se": np.sqrt(x * (1 - x) / runs) for name, x in shares.items()},
            "runs": runs,
        }
    )
    return table.reindex(columns=list(COLUMNS))


@pytest.mark.long
def test_false_alarms_are_rarer_than_one_table_in_a_hundred():
    """Of 500 pairs of tables of 160 figures; compared at once, judged a table at a time."""
    random, tables = np.random.default_rng(0), 500
    old, new = (
        pd.concat([drawn(random, 128, 40) for _ in range(tables)], ignore_index=True)
        for _ in range(2)
    )
    figures = ("bias", "rmse", "coverage95", "failure_share")
    p = [
        p_values(
            [name] * len(old),
            [old[name].to_numpy(), new[name].to_numpy()],
            [old[f"{name}_se"].to_numpy(), new[f"{name}_se"].to_numpy()],
            [old["runs"].to_numpy(dtype=float), new["runs"].to_numpy(dtype=float)],
        )
        for name in figures
    ]
    by_table = np.stack(p).reshape(len(figures), tables, 40).transpose(1, 0, 2)
    alarms = sum(holm(of_table.ravel(), comparison.FALSE_ALARM).any() for of_table in by_table)
    assert alarms <= 0.01 * tables


def test_fisher_and_holm_agree_with_values_done_by_hand():
    # Five of five against none of five: one of C(10, 5) = 252 tables on either side.
    shares, runs = [np.array([0.0]), np.array([1.0])], [np.array([5.0])] * 2
    assert share_p(shares, runs) == pytest.approx([2 / 252])
    assert share_p([np.array([0.0])] * 2, runs) == pytest.approx([1.0])
    p = np.array([0.01, 0.04, 0.03, 0.005])
    assert holm(p, 0.05).tolist() == [True, False, False, True]


def edited(table, row, **values):
    table = table.copy()
    for name, value in values.items():
        table.loc[row, name] = value
    return table


def test_figures_without_an_error_or_that_are_no_numbers():
    table = drawn(np.random.default_rng(1), 256, 1)
    still = edited(table, 0, bias_se=0.0, failure_share=0.0)
    assert verdicts(compare(still, still)) == {}
    same = edited(still, 0, bias=still["bias"][0] * (1 + 1e-12))
    assert verdicts(compare(still, same)) == {}
    moved = edited(still, 0, bias=still["bias"][0] * 1.001)
    assert verdicts(compare(still, moved)) == {("dry", "mu_max", "bias"): "moved"}
    lost = edited(table, 0, rmse=np.nan, rmse_se=np.nan)
    assert verdicts(compare(table, lost)) == {("dry", "mu_max", "rmse"): "worse"}
    assert verdicts(compare(lost, table)) == {("dry", "mu_max", "rmse"): "better"}
    assert verdicts(compare(lost, lost)) == {}
    failing = edited(still, 0, failure_share=0.1)
    assert verdicts(compare(still, failing)) == {("dry", "curve", "failure_share"): "worse"}
    assert verdicts(compare(failing, still)) == {("dry", "curve", "failure_share"): "better"}


def test_new_and_vanished_methods_are_told():
    table = drawn(np.random.default_rng(2), 256, 3)
    compared = compare(table.iloc[:2], table.iloc[1:])
    told = compared[compared["verdict"] != "same"].set_index("identifier")["verdict"]
    assert told.to_dict() == {"method-0": "gone", "method-2": "new"}
    text = moved_text(compared)
    assert "method-2 is not in the baseline" in text
    assert "method-0 is in the baseline but is no identifier" in text
    assert "gone" in comparison.REGRESSIONS
    assert "new" not in comparison.REGRESSIONS


@pytest.mark.long
def test_every_identifier_has_a_home_and_reaches_a_worker_as_it_is():
    places = homes(IDENTIFIERS)
    assert tuple(places) == tuple(IDENTIFIERS)
    assert places["ml-exact"] == HOMES[0]
    assert places["rls-kiencke"] == HOMES[1]
    assert places["ls-kiencke"] == HOMES[2]
    for identifier in IDENTIFIERS.values():
        sent = pickle.loads(pickle.dumps(identifier))
        assert jax.tree.structure(sent) == jax.tree.structure(identifier)


def test_a_method_without_a_scenario_is_refused():
    class Nowhere(Wrapped):
        def accepts(self, known):
            return "it is for nothing"

    with pytest.raises(InputError, match="nowhere accepts none"):
        homes({"nowhere": Nowhere(IDENTIFIERS[NAME])})


@pytest.mark.thorough
def test_a_baseline_is_read_as_it_was_written(tmp_path, baseline):
    path = tmp_path / "baseline.csv"
    baseline.to_csv(path, index=False)
    pd.testing.assert_frame_equal(
        read_baseline(path), baseline, check_exact=True, check_dtype=False
    )


def test_the_baseline_of_the_repository_holds_every_identifier():
    table = read_baseline(BASELINE)
    assert set(table["identifier"]) == set(IDENTIFIERS)
    assert set(table["runs"].dropna()) == {regression.RUNS}


@pytest.mark.long
@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda text: text.replace("rmse_se", "rmse_sd", 1), "no column rmse_se"),
        (lambda text: text.replace(",128.0,", ",many,", 1), "row 2, column runs: 'many'"),
        (lambda text: text.replace(",128.0,", ",0,", 1), "row 2, column runs is not above 0"),
        (lambda text: text + text.splitlines()[1] + "\n", "repeats an earlier row"),
        (lambda _: "", "is empty"),
        (lambda text: text.splitlines()[0] + "\n", "has a header and no rows"),
    ],
)
def test_a_spoilt_baseline_is_refused_in_a_sentence(tmp_path, baseline, spoil, words):
    path = tmp_path / "baseline.csv"
    path.write_text(spoil(baseline.to_csv(index=False)))
    with pytest.raises(InputError, match=words):
        read_baseline(path)


def test_a_missing_baseline_is_answered_before_any_work(tmp_path):
    missing = str(tmp_path / "none.csv")
    done = CliRunner().invoke(main, ["--baseline", missing, "--out", str(tmp_path)])
    assert isinstance(done.exception, InputError)
    assert "--update" in str(done.exception)


@pytest.mark.thorough
def test_the_command_updates_passes_and_fails(tmp_path, monkeypatch):
    monkeypatch.setattr(regression, "IDENTIFIERS", {NAME: IDENTIFIERS[NAME]})
    monkeypatch.setattr(regression, "RUNS", RUNS)
    taken = []
    monkeypatch.setattr(regression.runtime, "take_core", taken.append)  # not from these tests

    def measured(*_):  # no clock
        assert len(taken) == 1
        return speeds(40.0)

    monkeypatch.setattr(regression, "measure_speed", measured)
    path = tmp_path / "baseline.csv"
    asked = ["--baseline", str(path), "--out", str(tmp_path / "out")]
    done = CliRunner().invoke(main, [*asked, "--update"])
    assert done.exit_code == 0, done.output
    assert taken.pop() in os.sched_getaffinity(0)
    done = CliRunner().invoke(main, asked)
    assert done.exit_code == 0, done.output
    assert taken.pop() in os.sched_getaffinity(0)
    assert "0 of 49 figures got worse" in done.output
    names = {file.name for file in (tmp_path / "out").iterdir()}
    assert names == {"regression.csv", "comparison.csv"}
    assert tuple(pd.read_csv(tmp_path / "out" / "regression.csv")) == COLUMNS

    worse = read_baseline(path)
    worse.loc[worse["quantity"] == "c3", "bias"] += 0.02
    worse.to_csv(path, index=False)
    done = CliRunner().invoke(main, asked)
    assert done.exit_code == 1, done.output
    assert "moved" in done.output
    assert set(ACCURACY) < set(worse)


def test_methods_on_streams_are_measured_off_the_textbook_too(monkeypatch):
    asked = []

    def campaign(config, *_):
        asked.append((config.scenario, config.identifiers))
        columns = {name: [1.0] for name in ACCURACY} | dict.fromkeys(KEYS, "x")
        return SimpleNamespace(tables={"summary": pd.DataFrame(columns)})

    monkeypatch.setattr("experiments.regression.measuring.run_campaign", campaign)
    some = {name: IDENTIFIERS[name] for name in ("ml-exact", "riv", "rls-kiencke")}
    measure_accuracy(some, RUNS, 0, lambda _: None)
    away = ("qian2024-switch", "stream-coloured", "stream-burckhardt", "switch-drift")
    streams = [(scenario, ("riv", "rls-kiencke")) for scenario in away]
    assert asked == [("he2018-blocks", ("ml-exact",)), *streams]
