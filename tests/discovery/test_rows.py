"""Predictions at all rows, what is searched in blocks of rows, and test runs that are none."""

import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest
from discovery_campaigns import SIZE, runs_of
from scipy.signal import lfilter

from adhesion_jax.curves import CURVES
from adhesion_jax.data import matching, to_runs
from adhesion_jax.data.condensing import condensed
from adhesion_jax.data.reading import to_measured
from adhesion_jax.data.runs import in_blocks
from adhesion_jax.discovery import engine
from adhesion_jax.discovery.engine import discover, refuse_training_runs
from adhesion_jax.discovery.findings.errors_by_run import errors_of
from adhesion_jax.discovery.model import rows
from adhesion_jax.effects import EFFECTS
from adhesion_jax.effects.conditions import calendar_of
from adhesion_jax.effects.law import CorrectedLaw
from adhesion_jax.errors import InputError
from experiments.campaigns.simulator import simulate


@pytest.fixture(scope="module")
def runs():
    return runs_of(simulate(["humidity"], seed=4, **SIZE).train)


def law_with_memory(runs):
    lag = EFFECTS["lag"].starts({})[0]
    return CorrectedLaw(CURVES["burckhardt"], (lag,), {}, calendar_of(runs.record))


def test_predictions_in_pieces_are_those_of_whole_runs(runs, monkeypatch):
    law = law_with_memory(runs)
    whole = rows.predicted(law, runs)
    side_by_side = np.asarray(rows._of_runs(law, runs.record.slip, runs.record.conditions))
    np.testing.assert_array_equal(whole, side_by_side[np.asarray(runs.record.mask)])
    # Some runs at a time, padded to 256 points.
    monkeypatch.setattr(rows, "_CELLS", 600)
    np.testing.assert_allclose(rows.predicted(law, runs), whole, rtol=1e-12)


def test_a_long_run_in_stretches_remembers_what_was_before(runs, monkeypatch):
    """A lag of .3 s has forgotten the start of the lead-in, 64 points of .1 s, up to exp(-21)."""
    law = law_with_memory(runs)
    whole = rows.predicted(law, runs)
    monkeypatch.setattr(rows, "_CELLS", 64)
    monkeypatch.setattr(rows, "_FEWEST_POINTS", 16)
    pieces = list(rows._pieces(runs))
    told = np.concatenate([held[inside] for held, inside in pieces])
    assert sorted(told.tolist()) == list(range(runs.whole.slip.size))
    np.testing.assert_allclose(rows.predicted(law, runs), whole, atol=2e-6)


def test_test_runs_that_are_training_runs_are_refused(runs):
    campaign = simulate(["humidity"], seed=4, **SIZE)
    other = runs_of(campaign.test)
    refuse_training_runs(runs, other)
    both = runs_of(pd.concat([campaign.test, campaign.train.query("run == run.min()")]))
    with pytest.raises(InputError, match="1 of the 8 runs of the test data is in the training"):
        refuse_training_runs(runs, both)
    # One run alone is refused as well; part of a log that was fitted in blocks is so by its blocks.
    alone = to_runs([to_measured("alone", campaign.train.query("run == run.min()"))])
    assert alone.names == runs.names[:1]
    with pytest.raises(InputError, match="1 of the 1 runs of the test data is in the training"):
        refuse_training_runs(runs, alone)
    log = to_runs([to_measured("log", campaign.train.assign(run="log"))])
    with pytest.raises(InputError, match="50 of the 50 blocks of the test data are in the"):
        refuse_training_runs(in_blocks(log), log)


def test_one_test_run_is_predicted_as_a_whole(runs):
    """A lag remembers its beginning at its end: the run is not cut for its errors or its law."""
    first = runs.whole.slip[: runs.lengths[0]]
    table = simulate(["humidity"], seed=4, **SIZE).train
    alone = to_runs([to_measured("alone", table[table["run"] == table["run"].iloc[0]])])
    np.testing.assert_array_equal(alone.whole.slip, first)
    lag = EFFECTS["lag"](time_constant=2.0)
    law = CorrectedLaw(CURVES["burckhardt"], (lag,), {}, calendar_of(runs.record))
    conditions = {name: jnp.asarray(rows) for name, rows in alone.whole.conditions.items()}
    whole = np.asarray(law(jnp.asarray(alone.whole.slip), conditions))
    predicted = rows.predicted(law, matching(runs, alone))
    np.testing.assert_allclose(predicted, whole, rtol=1e-12)
    told = errors_of(matching(runs, alone), predicted, predicted, 0)
    assert (told.runs, told.after.value > 0) == (1, True)
    assert np.isnan([told.after.low, told.after.high, told.removed.low]).all()


def long_campaign(seed, size, r, rows_a_run=10_000, count=30, sigma=0.01):
    """Runs at 100 Hz in which humidity walks; its effect has `size` times the rms of the noise."""
    draw = np.random.default_rng(seed)
    time = np.arange(rows_a_run) / 100

    def walk(kept, scale):
        noise = draw.normal(size=rows_a_run + 5000)
        return scale * lfilter([np.sqrt(1 - kept**2)], [1, -kept], noise)[5000:]

    parts = []
    for run in range(count):
        sweep = np.sin(np.pi * draw.integers(1, 4) * time / time[-1]) ** 2
        slip = 0.002 + draw.uniform(0.08, 0.2) * sweep
        columns = {
            "run": run,
            "time_s": time + 300.0 * run,
            "slip_ratio": slip,
            "vehicle_speed_mps": draw.uniform(8, 25) + walk(0.9995, 1.0),
            "relative_humidity_pct": np.clip(60 + walk(0.9995, 12.0), 1, 99),
            "temperature_C": 15 + walk(0.9995, 4.0),
            "curve": 0.35 * (1 - np.exp(-45 * slip)) - 0.4 * slip,
            "noise": walk(r, sigma),
        }
        parts.append(pd.DataFrame(columns))
    table = pd.concat(parts, ignore_index=True)
    shape = table["curve"] * (table["relative_humidity_pct"] - 60) / 12
    shape *= size * sigma / np.sqrt(np.mean(shape**2))
    table["adhesion"] = table["curve"] + shape + table["noise"]
    return runs_of(table.drop(columns=["curve", "noise"]))


def check_bounds(found):
    """Those parameters of effects of the catalogue are told that stand at a bound, and no other."""
    for effect in found.effects:
        for name, described in EFFECTS[effect.name].FACTS.parameters.items():
            if name in effect.parameters:
                value = effect.parameters[name].value
                at = value in (described.lower, described.upper)
                assert at == (name in effect.at_bound), name
                assert at == np.isnan(effect.parameters[name].low), name


@pytest.mark.slow
@pytest.mark.parametrize("r", [0.0, 0.5])
def test_an_effect_of_a_twentieth_of_the_noise_is_found_in_many_rows(r):
    found = discover(long_campaign(0, 0.05, r))
    assert "humidity" in {name for effect in found.effects for name in effect.candidates}
    check_bounds(found)
    assert found.noise["sigma"] == pytest.approx(0.01, rel=0.01)
    assert found.noise["autocorrelation"] == pytest.approx(r, abs=0.01)
    assert found.train.after.value < found.train.before.value
    bare = discover(long_campaign(0, 0.0, r))
    assert bare.effects == bare.unexplained == ()


@pytest.fixture(scope="module")
def in_rows_and_blocks():
    """What is found in 5,000 rows, and in the same as 1,250 blocks."""
    whole = runs_of(simulate(["humidity"], seed=4, runs=36, points=200).train)
    found = discover(whole)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(engine, "condensed", lambda runs: condensed(runs, 1_250))
        return found, discover(whole)


@pytest.mark.thorough
def test_blocks_name_what_the_rows_do_and_tell_the_noise_of_rows(in_rows_and_blocks):
    found, fewer = in_rows_and_blocks
    assert [effect.name for effect in found.effects] == ["humidity"]
    assert [effect.name for effect in fewer.effects] == ["humidity"]
    for name, (value, low, high) in found.effects[0].parameters.items():
        again = fewer.effects[0].parameters[name]
        assert abs(again.value - value) < 0.5 * (high - low) / (2 * 1.96), name
    for one in (found, fewer):
        # The noise of the simulator, of which the means of four rows would have a half.
        assert one.noise["sigma"] == pytest.approx(0.007, rel=0.06)
        assert one.noise["autocorrelation"] == pytest.approx(0.4, abs=0.07)


@pytest.mark.thorough
@pytest.mark.xfail(reason="the law is fitted to the blocks alone: .5 % more is left of the rows")
def test_blocks_find_what_the_rows_would(in_rows_and_blocks):
    """The same effect, well within its error."""
    found, fewer = in_rows_and_blocks
    assert [effect.name for effect in fewer.effects] == [effect.name for effect in found.effects]
    assert any("neighbouring rows, by their means" in words for words in fewer.warnings)
    assert len(fewer.points) == pytest.approx(1_250, rel=0.02)
    check_bounds(found)
    assert fewer.train.after.value == pytest.approx(found.train.after.value, rel=1e-4)
    for name, value in found.noise.items():
        assert fewer.noise[name] == pytest.approx(value, rel=1e-3)
    for one, other in zip(found.effects, fewer.effects, strict=True):
        for name, (value, low, high) in one.parameters.items():
            error = (high - low) / (2 * 1.96)
            again = other.parameters[name]
            assert abs(again.value - value) < 0.2 * error, name
            assert again.high - again.low == pytest.approx(high - low, rel=0.02)
