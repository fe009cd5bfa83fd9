import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest
from scipy.interpolate import CubicSpline

from adhesion_jax.errors import InputError
from experiments.campaigns.base import conditions_of, on_runs
from experiments.campaigns.plantable import CleanRuns
from experiments.campaigns.runs import draw_curve, draw_runs
from experiments.campaigns.simulator import SetNoise, simulate
from experiments.discovery_study.one_log import one_log
from experiments.discovery_study.random_effect import (
    ACTS_ON,
    RandomEffect,
    has_peak,
    peak_on_grid,
    random_plan,
    simulate_random,
    smooth_function,
    total_effect,
)
from experiments.discovery_study.tasks import draw_random_effect

SMALL = {"runs": 20, "points": 60}
ONE, TWO = ("temperature_C",), ("relative_humidity_pct", "vehicle_speed_mps")


def small_runs(family="burckhardt", seed=0):
    runs = draw_runs(20, 60, False, np.random.default_rng(seed))
    return runs, on_runs(draw_curve(family, np.random.default_rng(1)), conditions_of(runs))


def test_total_effects_are_those_known_by_hand():
    generator = np.random.default_rng(0)
    points = generator.uniform(0, 1, (200_000, 2))

    def share(function, place):
        return total_effect(function, points, function(points), place, generator)

    # A sum of 2 x and y: variances 4 to 1. The product of two centred ones: all of it is joint.
    assert share(lambda u: 2 * u[:, 0] + u[:, 1], 0) == pytest.approx(0.8, abs=0.01)
    assert share(lambda u: 2 * u[:, 0] + u[:, 1], 1) == pytest.approx(0.2, abs=0.01)
    joint = lambda u: (u[:, 0] - 0.5) * (u[:, 1] - 0.5)  # noqa: E731
    assert share(joint, 0) == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("count", [1, 2])
def test_a_random_function_is_centred_of_size_one_and_smooth(count):
    grid = np.linspace(0.0, 1.0, 40)
    points = np.stack(np.meshgrid(*[grid] * count, indexing="ij"), axis=-1).reshape(-1, count)
    seen = []
    for seed in range(12):
        values, scales = smooth_function(7.0 + 30 * points, np.random.default_rng(seed))
        assert np.median(values) == pytest.approx(0.0, abs=1e-12)
        assert np.abs(values).max() == pytest.approx(1.0)
        assert np.all((scales > 0.3) & (scales < 1.5))
        surface = values.reshape([40] * count)
        # A cubic spline through every third value, .077 of the range apart, tells all others.
        spline = CubicSpline(grid[::3], surface[::3])
        np.testing.assert_allclose(spline(grid), surface, atol=0.02)
        if count == 2:
            # Shares of the variance on the full grid, where the columns are independent.
            for axis in (0, 1):
                share = np.var(surface, axis=axis).mean() / np.var(surface)
                assert share > 0.2
            mean = surface.mean(axis=0) + surface.mean(axis=1)[:, None] - surface.mean()
            seen.append(np.abs(surface - mean).max() < 1e-9)
    if count == 2:
        assert 0 < sum(seen) < 12  # some are sums, some are joint


def test_a_random_effect_acts_on_the_level_the_slip_or_the_fall():
    runs, curve = small_runs()
    slip = runs.slip
    base = curve(slip)

    def plan(acts_on):
        generator = np.random.default_rng(5)
        clean = CleanRuns(slip, runs.columns, conditions_of(runs), curve, generator)
        return random_plan(RandomEffect(ONE, acts_on), clean)

    level = plan("level")
    g = np.log(level.make(0.2).after(base) / base)
    assert np.abs(g).max() == pytest.approx(0.2)
    # The same function of the same column, on the slip and on the fall.
    of_slip = plan("slip")
    np.testing.assert_allclose(of_slip.make(0.2).before(slip), slip * np.exp(g))
    of_fall = plan("fall")
    law = draw_curve("burckhardt", np.random.default_rng(1))
    c1, c2, c3 = (float(getattr(law, name)) for name in ("c1", "c2", "c3"))
    where = np.log(c1 * c2 / c3) / c2
    height = c1 - c3 / c2 * (1 + np.log(c1 * c2 / c3))
    fallen = of_fall.make(0.2).after(base)
    beyond = np.abs(slip) > where
    np.testing.assert_array_equal(
        fallen[np.abs(slip) < where - 1e-3], base[np.abs(slip) < where - 1e-3]
    )
    expected = np.sign(slip) * (height - (height - np.abs(base)) * np.exp(g))
    np.testing.assert_allclose(fallen[beyond], expected[beyond], atol=1e-4 * height)
    # At its limit it leaves a third of the adhesion, and somewhere no more.
    strongest = of_fall.make(of_fall.limit).after(base) / base
    assert strongest.min() == pytest.approx(1 / 3, rel=1e-3)


def test_the_peak_of_a_law_with_speed_is_found_at_each_point():
    runs, curve = small_runs("polach-falling")
    where, height = peak_on_grid(curve, runs.slip.shape)
    for factor in (0.9, 1.1):
        assert np.all(curve(factor * where) <= height)
    assert np.ptp(where) > 0
    assert has_peak(curve, runs.slip.shape)
    assert not has_peak(np.tanh, (2, 3))


@pytest.mark.long
@pytest.mark.parametrize("acts_on", ACTS_ON)
@pytest.mark.parametrize("columns", [ONE, TWO])
def test_a_random_effect_is_planted_alike_each_time_and_recorded(acts_on, columns):
    effect = RandomEffect(columns, acts_on)
    quiet = SetNoise(1e-9, 0.0, 0.0)
    one, other = (
        simulate_random(effect, seed=3, strength=0.03, noise=quiet, **SMALL) for _ in range(2)
    )
    pd.testing.assert_frame_equal(one.train, other.train, check_exact=True)
    assert {f"length_scale_{name}" for name in columns} < set(one.parameters["random"])
    null = simulate(seed=3, base=one.base, noise=quiet, **SMALL)
    planted, bare = (
        pd.concat([campaign.train, campaign.test])["adhesion"] for campaign in (one, null)
    )
    size = np.quantile(np.abs(planted - bare), 0.95) / np.quantile(np.abs(bare), 0.95)
    assert size == pytest.approx(0.03, rel=0.02)


@pytest.mark.slow
def test_a_fall_needs_a_base_that_falls_and_others_keep_theirs():
    kept, changed = [], []
    for seed in range(12):
        plain = simulate(seed=seed, base="exponential", **SMALL)
        fallen = simulate_random(
            RandomEffect(ONE, "fall"), seed=seed, base="exponential", strength=0.05, **SMALL
        )
        slip = np.linspace(0.0, 0.14, 200)
        turns = np.argmax(np.asarray(plain.curve(jnp.asarray(slip), {}))) < 199
        (kept if fallen.base == "exponential" else changed).append(turns)
    assert all(kept)
    assert not any(changed)


def test_random_effects_are_drawn_over_all_columns():
    generator = np.random.default_rng(0)
    drawn = [draw_random_effect("level", 2, generator) for _ in range(60)]
    assert all(len({*effect.columns}) == 2 for effect in drawn)
    assert len({name for effect in drawn for name in effect.columns}) == 7


def test_a_log_has_its_events_its_noise_and_its_columns():
    kinds = {"sigma": 0.008, "autocorrelation": 0.6}
    log = one_log(seed=4, wheel_speed_noise=0.03, **kinds)
    table = log.train
    assert "run" not in table
    assert len(table) == len(log.test) == 3000
    np.testing.assert_allclose(np.diff(table["time_s"]), 0.1, atol=1e-9)
    assert table["vehicle_speed_mps"].between(5, 10).all()
    # The same log with an exact wheel speed.
    slip = one_log(seed=4, **kinds).train["slip_ratio"].to_numpy()
    assert np.median(slip) == pytest.approx(0.004)
    starts = np.flatnonzero(np.diff((slip > 0.00401).astype(int)) == 1)
    ends = np.flatnonzero(np.diff((slip > 0.00401).astype(int)) == -1)
    assert len(starts) == len(ends) == 5
    assert np.all((ends - starts > 35) & (ends - starts <= 80))
    peaks = [slip[a:b].max() for a, b in zip(starts, ends + 1, strict=True)]
    assert min(peaks) > 0.075
    assert max(peaks) < 0.25
    noise = (table["slip_ratio"] - slip) * table["vehicle_speed_mps"]
    assert np.std(noise) == pytest.approx(0.03, rel=0.05)
    assert abs(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 0.06
    np.testing.assert_allclose(
        table["slip_velocity_mps"], table["slip_ratio"] * table["vehicle_speed_mps"]
    )
    c1, c2, c3 = (float(getattr(log.curve, name)) for name in ("c1", "c2", "c3"))
    error = table["adhesion"] - (c1 * (1 - np.exp(-c2 * slip)) - c3 * slip)
    assert np.std(error) == pytest.approx(0.008, rel=0.08)
    assert np.corrcoef(error[1:], error[:-1])[0, 1] == pytest.approx(0.6, abs=0.05)
    assert 0 < table["sanding"].mean() < 0.3


@pytest.mark.parametrize(("runs", "points"), [(5, 600), (28, 200)])
def test_logs_of_runs_have_an_event_each_and_weather_of_their_own(runs, points):
    log = one_log(["humidity"], seed=1, runs=runs, points=points)
    by_run = log.train.groupby("run")
    assert len(by_run) == runs
    assert (by_run.size() == points).all()
    assert (by_run["slip_ratio"].max() > 0.07).all()
    means = by_run.mean()
    for name, spread in (("normal_load_N", 2e4), ("relative_humidity_pct", 10)):
        assert np.ptp(means[name]) > spread
    assert (log.train["time_s"].diff().dropna() > 0).all()


@pytest.mark.parametrize("name", ["humidity", "sanding", "falling_friction"])
def test_an_effect_of_a_log_is_visible_by_its_sigma(name):
    log = one_log([name], seed=2, autocorrelation=0.3)
    bare = one_log(seed=2, autocorrelation=0.3)
    assert log.visible == pytest.approx(1.0, rel=0.05)
    assert bare.visible < 1e-3
    others = [column for column in bare.train if column != "adhesion"]
    pd.testing.assert_frame_equal(log.train[others], bare.train[others], check_exact=True)
    ratio = (log.clean / bare.clean)[np.abs(bare.clean) > 0]
    if name == "humidity":
        # A straight line of log ratio against humidity, through 0 at 65 %.
        amount = log.parameters[name]["amount"]
        humidity = log.test["relative_humidity_pct"].to_numpy()
        np.testing.assert_allclose(np.log(ratio), -amount * (humidity - 65) / 20, atol=1e-12)
    if name == "sanding":
        assert np.all(ratio >= 1)
        assert ratio[log.test["sanding"] == 1].mean() > ratio[log.test["sanding"] == 0].mean()
    if name == "falling_friction":
        assert np.corrcoef(ratio, log.test["slip_velocity_mps"])[0, 1] < -0.8


def test_logs_are_the_same_each_time_and_refuse_what_they_do_not_know():
    first, again = (one_log(["sanding"], seed=7, wheel_speed_noise=0.01) for _ in range(2))
    pd.testing.assert_frame_equal(first.train, again.train, check_exact=True)
    pd.testing.assert_frame_equal(first.test, again.test, check_exact=True)
    with pytest.raises(InputError, match="known are humidity, sanding, falling_friction"):
        one_log(["patch"], seed=0)
    with pytest.raises(InputError, match="no room"):
        one_log(seed=0, points=50)


def test_a_wheel_of_forty_six_centimetres_turns_by_what_it_rolls():
    runs, _ = small_runs()
    rolled = 0.1 * runs.columns["vehicle_speed_mps"] * (1 + runs.slip)
    turned = np.diff(runs.columns["wheel_angle_rad"], axis=1)
    np.testing.assert_allclose(0.46 * turned, rolled[:, 1:], rtol=1e-9)
