"""What was found in blocks, at all rows: predictions in pieces, the loss, the fit and the test."""

import jax
import numpy as np
import pandas as pd
import pytest
from discovery_campaigns import SIZE, runs_of
from scipy import stats
from scipy.signal import lfilter

from adhesion_jax.curves import BASES, CURVES
from adhesion_jax.data.condensing import condensed
from adhesion_jax.discovery import engine
from adhesion_jax.discovery.engine import discover
from adhesion_jax.discovery.model import rows
from adhesion_jax.discovery.model.bases import starts_under
from adhesion_jax.discovery.model.fitting import (
    Setting,
    covariance,
    fit_model,
    likeliest,
    p_of,
)
from adhesion_jax.discovery.model.noise import _half_deviance, white_noise
from adhesion_jax.discovery.model.problem import prepare
from adhesion_jax.discovery.model.training_runs import refuse_training_runs
from adhesion_jax.effects import EFFECTS, Covariate
from adhesion_jax.effects.conditions import calendar_of
from adhesion_jax.effects.law import CorrectedLaw
from adhesion_jax.errors import InputError
from adhesion_jax.simulation.simulator import simulate


@pytest.fixture(scope="module")
def runs():
    return runs_of(simulate(["humidity"], seed=4, **SIZE).train)


@pytest.fixture(scope="module")
def fitted(runs):
    """A curve with humidity, under the noise that it leaves."""
    record = runs.record
    problem = prepare(record, calendar_of(record), runs.blocks)
    adhesion = np.asarray(problem.data.adhesion)
    white = Setting(problem, white_noise(problem.points, 0.02), adhesion)
    alone = min(starts_under(white, ["burckhardt"]), key=lambda start: start.total)
    line = Covariate(0.0, 60.0, 20.0, column="relative_humidity_pct", acts_on="level")
    found = likeliest(white, "burckhardt", alone.base_values.tolist(), (line,))
    return fit_model(found.setting, found.base, found.base_values.tolist(), found.effects)


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
    told = np.concatenate([piece.held[piece.inside] for piece in pieces])
    assert sorted(told.tolist()) == list(range(runs.whole.slip.size))
    # Every row but the first of a run follows on one of its own run.
    linked = sum(int(piece.linked.sum()) for piece in pieces)
    assert linked == runs.whole.slip.size - len(runs.names)
    np.testing.assert_allclose(rows.predicted(law, runs), whole, atol=2e-6)


def test_the_loss_of_the_rows_is_the_likelihood_and_its_derivatives(fitted, runs):
    noise = fitted.setting.noise
    at = fitted.values[list(fitted.places)]
    precision = rows._model(fitted).precision

    def loss(values):
        law, tangents = rows._law_and_tangents(fitted, values, {})
        products = rows._products(law, tangents, runs)
        given = rows._Noise(
            float(noise.sigma), float(noise.autocorrelation), float(noise.run_scatter)
        )
        return rows._loss(products, given, values[list(fitted.places)], precision)

    here = loss(fitted.values)
    law, _ = rows._law_and_tangents(fitted, fitted.values, {})
    level = np.asarray(rows._of_runs(law, runs.record.slip, runs.record.conditions))
    residual = np.asarray(runs.record.adhesion) - level
    prior = 0.5 * at @ precision @ at
    assert here.total == pytest.approx(_half_deviance(noise, residual, level) + prior, rel=1e-10)
    for number, place in enumerate(fitted.places):
        step = 1e-5 * max(abs(fitted.values[place]), 1e-2)
        nudge = step * np.eye(fitted.values.size)[place]
        ahead, behind = loss(fitted.values + nudge), loss(fitted.values - nudge)
        slope = (ahead.total - behind.total) / (2 * step)
        # The level of the noise's random factor moves with the curve; the gradient holds it.
        held = (ahead.loss.sum() - behind.loss.sum()) / (2 * step)
        scale = np.sqrt(here.hessian.sum(0)[number, number])
        assert abs(here.gradient.sum(0)[number] - held) < 0.2 * scale, (slope, held)


def test_rows_that_are_their_own_blocks_are_fitted_as_the_search_does(fitted, runs):
    moved = fitted.base_values * 1.1
    away = fit_model(fitted.setting, fitted.base, moved.tolist(), fitted.effects, near=np.inf)
    np.testing.assert_allclose(away.base_values, moved, rtol=1e-12)
    found = rows.fitted_to_rows(away, runs, {}, white=False)
    error = np.sqrt(np.diag(covariance(fitted)))
    off = (found.rows.values - fitted.values)[list(fitted.places)] / error
    assert np.abs(off).max() < 0.05
    assert float(found.rows.setting.noise.sigma) == pytest.approx(
        float(fitted.setting.noise.sigma), rel=1e-2
    )
    assert p_of(found.rows, [0]) < 1e-6


@pytest.mark.parametrize("spoiled", ["promise", "step"])
def test_a_bad_step_is_not_the_end_of_the_fit(fitted, runs, monkeypatch, spoiled):
    """The first step promises a rise, as at a bound, or leads far away."""
    moved = fitted.base_values * 1.1
    away = fit_model(fitted.setting, fitted.base, moved.tolist(), fitted.effects, near=np.inf)
    taken, ahead = [], rows._step

    def step(*given):
        found, promised = ahead(*given)
        taken.append(given[-1])
        if len(taken) > 1:
            return found, promised
        return (found, -1.0) if spoiled == "promise" else (-20.0 * found, promised)

    monkeypatch.setattr(rows, "_step", step)
    found = rows.fitted_to_rows(away, runs, {}, white=False)
    error = np.sqrt(np.diag(covariance(fitted)))
    off = (found.rows.values - fitted.values)[list(fitted.places)] / error
    assert np.abs(off).max() < 0.05
    # Damped after a step that was refused, and after that one less and less.
    assert (max(taken) > 1e-4) == (spoiled == "step")


def test_p_of_one_strength_is_that_of_students_t(fitted):
    """With the other parameters of an effect held, of which this one has none."""
    place = fitted.places.index(max(fitted.places))
    t = fitted.values[fitted.places[place]] / np.sqrt(covariance(fitted)[place, place])
    count = int((np.abs(fitted.hessian).sum((1, 2)) > 0).sum())
    assert p_of(fitted, [0]) == pytest.approx(2 * stats.t.sf(abs(t), count - 1), rel=1e-6)


def test_an_effect_that_rests_on_one_run_is_not_sure(fitted):
    """Without that run its strength would be zero: of R runs t is the root of (R - 1)/R."""
    place = fitted.places.index(max(fitted.places))
    strength = fitted.values[fitted.places[place]]
    gradient = np.zeros_like(fitted.gradient)
    gradient[3] = strength * fitted.hessian.sum(0)[:, place]
    count = len(fitted.loss)
    expected = 2 * stats.t.sf(np.sqrt((count - 1) / count), count - 1)
    assert p_of(fitted._replace(gradient=gradient), [0]) == pytest.approx(expected, rel=1e-6)


def test_a_mean_of_moving_slip_is_less_than_the_curve_by_its_bend(fitted):
    """With the variance v of the slip within a block the mean is mu + mu'' v/2 to second order."""
    slip = np.tile(np.linspace(0.0, 0.15, 9000), 2)
    table = pd.DataFrame({"run": np.repeat([0, 1], 9000), "slip_ratio": slip, "adhesion": slip})
    runs = runs_of(table)
    blocks = condensed(runs, 100)
    curve = BASES["burckhardt"]
    bare = fitted._replace(effects=())
    found = rows.bends(bare, runs, blocks)
    c1, c2, _ = bare.base_values
    number = np.diff(blocks.places, append=slip.size)
    squares = np.add.reduceat(slip**2, blocks.places) / number
    second = -c1 * c2**2 * np.exp(-c2 * blocks.whole.slip)
    expected = 0.5 * second * (squares - blocks.whole.slip**2)
    np.testing.assert_allclose(found, expected, atol=0.02 * np.abs(expected).max())
    assert curve.free == ("c1", "c2", "c3")


def test_test_runs_that_are_training_runs_are_refused(runs):
    campaign = simulate(["humidity"], seed=4, **SIZE)
    other = runs_of(campaign.test)
    refuse_training_runs(runs, other)
    both = runs_of(pd.concat([campaign.test, campaign.train.query("run == run.min()")]))
    with pytest.raises(InputError, match="1 of the 8 runs of the test data is in the training"):
        refuse_training_runs(runs, both)


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
        for name, described in EFFECTS[effect.name].PARAMETERS.items():
            if name in effect.parameters:
                value = effect.parameters[name].value
                at = value in (described.lower, described.upper)
                assert at == (name in effect.at_bound), name


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


@pytest.mark.thorough
def test_blocks_find_what_the_rows_would():
    """5,000 rows and the same as 1,250 blocks: the same effect, well within its error."""
    campaign = simulate(["humidity"], seed=4, runs=36, points=200)
    whole = runs_of(campaign.train)
    found = discover(whole)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(engine, "condensed", lambda runs: condensed(runs, 1_250))
        fewer = discover(whole)
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
    jax.clear_caches()
