"""What is shown of an effect over its columns, and what its sentence says of its form."""

import dataclasses

import numpy as np
import pytest
from discovery_campaigns import alone, campaign, curve, noise, state_of

from adhesion_jax.data.columns import unit_of
from adhesion_jax.discovery.findings.cautions import beyond_points
from adhesion_jax.discovery.findings.dependence import dependences
from adhesion_jax.discovery.findings.errors_by_run import errors
from adhesion_jax.discovery.findings.found import found_effects
from adhesion_jax.discovery.model.packing import base_places
from adhesion_jax.discovery.search.state import Accepted, Selection
from adhesion_jax.discovery.types import BRAKING
from adhesion_jax.effects import EFFECTS, Constant, Covariate, Labels, Memory, Threshold


@pytest.mark.long
def test_of_labels_only_the_labels_are_shown_and_by_their_names():
    draw = np.random.default_rng(5)
    table = campaign(draw)
    level = table["place"].map({"a": 1.2, "b": 1.0, "c": 0.9, "d": 0.9}).to_numpy()
    table["adhesion"] = level * curve(table["slip_ratio"]) + noise(draw, sigma=0.002)
    (labels,) = Labels.starts({"place": np.arange(4.0)})
    load = Covariate(0.0, 9.0, 1.0, column="load", acts_on="offset")
    parts = labels, load, dataclasses.replace(load, acts_on="slip")
    name = "covariate:place"
    state = state_of(
        table, Accepted(name, (name,), "place", True, ("place",), parts, p=0.0005, gain=90.0)
    )
    (shown,) = dependences(state, seed=0)
    assert shown.labels == ("a", "b", "c", "d")
    ratios = shown.factor / shown.factor.mean()
    np.testing.assert_allclose(ratios, np.array([1.2, 1.0, 0.9, 0.9]), atol=0.01)
    assert ((shown.low < shown.factor) & (shown.factor < shown.high)).all()

    (told,) = found_effects(state, errors(np.ones(9), np.ones(9), np.ones(9), 0))
    assert told.sentence == (
        "Structure against place; no physical cause is claimed. Its form is refined by "
        "covariate on the offset, covariate on the slip and constant on the offset."
    )
    assert told.refined_on == ("offset", "slip", "offset")
    # Neither hides the parameters of the other.
    refined = {"covariate on the offset k", "covariate on the slip k", "constant on the offset k"}
    assert {*(f"k of {one}" for one in "abcd"), *refined} == {*told.parameters} == {*told.units}


def test_what_stretches_the_slip_scale_is_shown_where_it_changes_adhesion_most():
    """The peak lies at half the slip in the warm; at the median slip little is seen of that."""
    draw = np.random.default_rng(8)
    table = campaign(draw)
    warm = table["run"] / table["run"].max()
    table["warm"] = warm
    scale = 2.0 ** -(warm - 0.5)
    table["adhesion"] = curve(table["slip_ratio"] / scale) + noise(draw, sigma=0.002)
    part = Covariate(0.1, 0.5, 0.5, column="warm", acts_on="slip")
    name = "covariate:warm"
    effect = Accepted(name, (name,), "warm", True, ("warm",), (part,), p=0.0005, gain=90.0)
    (shown,) = dependences(state_of(table, effect), seed=0)
    slips = np.quantile(table["slip_ratio"].abs(), np.linspace(0.02, 0.98, 17))
    cold, hot = 2**0.5, 2**-0.5
    changes = np.abs(curve(slips / hot) - curve(slips / cold))
    assert shown.at_slip == pytest.approx(slips[changes.argmax()], rel=1e-6)
    expected = curve(shown.at_slip / hot) / curve(shown.at_slip / cold)
    assert shown.factor[-1] / shown.factor[0] == pytest.approx(expected, rel=0.03)
    assert abs(expected - 1) > 0.1


def test_the_band_of_a_line_is_that_of_its_slope():
    draw = np.random.default_rng(3)
    table = campaign(draw)
    load = table["load"].to_numpy()
    table["adhesion"] = np.exp(0.05 * (load - 9.0)) * curve(table["slip_ratio"]) + noise(draw)
    part = Covariate(0.0, 9.0, 1.0, column="load")
    effect = Accepted(
        "covariate:load", ("covariate:load",), "load", True, ("load",), (part,), 0.0005, 90.0
    )
    state = state_of(table, effect)
    (shown,) = dependences(state, seed=0)
    (told,) = found_effects(state, errors(np.ones(9), np.ones(9), np.ones(9), 0))
    slope, away = told.parameters["k"], shown.values - 9.0
    ends = np.sort([slope.low * away, slope.high * away], axis=0)
    np.testing.assert_allclose(np.log([shown.low, shown.high]), ends, atol=1e-6)
    assert 0.005 < slope.high - slope.low < 0.05


@pytest.mark.parametrize("width", [1e-12, 0.05])
def test_an_offset_is_shown_where_adhesion_is_largest_and_a_sharp_step_has_a_narrow_band(width):
    """Where a step lies between two values of a column no point tells, nor how wide it is."""
    draw = np.random.default_rng(12)
    table = campaign(draw)
    table["worn"] = (table["run"] % 3 == 0).astype(float)
    added = 0.03 * table["worn"].to_numpy()
    table["adhesion"] = curve(table["slip_ratio"]) + added + noise(draw, sigma=0.002)
    step = Threshold(0.0, 0.5, width, 0.0, column="worn", acts_on="offset")
    parts = step, Constant(0.0, acts_on="offset")
    name = "covariate:worn"
    effect = Accepted(name, (name,), "worn", True, ("worn",), parts, p=0.0005, gain=90.0)
    state = state_of(table, effect)
    (shown,) = dependences(state, seed=0)
    slips = np.quantile(table["slip_ratio"].abs(), np.linspace(0.02, 0.98, 17))
    assert shown.at_slip == pytest.approx(slips[curve(slips).argmax()], rel=1e-6)
    level = curve(shown.at_slip)
    ratio = shown.factor[-1] / shown.factor[0]
    assert ratio == pytest.approx((level + 0.03) / level, rel=0.01)
    assert (shown.high / shown.low < 1.1).all()
    (told,) = found_effects(state, errors(np.ones(9), np.ones(9), np.ones(9), 0))
    assert {*told.parameters} == {"k", "constant on the offset k"}


def test_a_law_far_beyond_all_points_between_their_slips_is_not_to_be_believed():
    """A curve with two poles among the slips; that of the points has none."""
    draw = np.random.default_rng(14)
    table = campaign(draw)
    table["adhesion"] = curve(table["slip_ratio"]) + noise(draw, sigma=0.002)
    state = Selection(alone(table, "kiencke", (0.35 * 60, 60 - 2 / 0.06, 0.06**-2)))
    assert beyond_points(state) == ()
    # The denominator 1 - 60 l + 800 l^2 is negative between slips of 0.025 and 0.05.
    values = state.fitted.values.copy()
    values[base_places("kiencke")[:3]] = 20.0, -60.0, 800.0
    (told,) = beyond_points(state._replace(fitted=state.fitted._replace(values=values)))
    assert "the law is not to be believed" in told
    at = float(told.split("at slip ")[1].split(",")[0])
    assert at == pytest.approx(0.025, abs=0.003) or at == pytest.approx(0.05, abs=0.003)


@pytest.mark.parametrize(("times", "sentences"), [(2.9, 0), (3.1, 1)])
def test_a_law_is_believed_up_to_three_times_the_largest_adhesion_of_the_points(times, sentences):
    draw = np.random.default_rng(15)
    table = campaign(draw)
    table["adhesion"] = curve(table["slip_ratio"]) + noise(draw, sigma=0.0005)
    state = Selection(alone(table, "kiencke", (0.35 * 60, 60 - 2 / 0.06, 0.06**-2)))
    values = state.fitted.values.copy()
    # The law is proportional to its initial slope, and follows the points to .0005.
    values[0] *= times * table["adhesion"].max() / state.fitted.adhesion.max()
    larger = state._replace(fitted=state.fitted._replace(values=values))
    assert len(beyond_points(larger)) == sentences


def test_sand_is_shown_for_as_long_as_it_was_on_and_from_before_it_was():
    """Sand that takes 3 s to arrive was on for 2 s at a time, and wets the rail at once."""
    draw = np.random.default_rng(4)
    table = campaign(draw)
    second = table["time_s"] - table.groupby("run")["time_s"].transform("min")
    on = (second % 10 >= 4) & (second % 10 < 6)
    step = table["time_s"].diff().where(table["run"].diff() == 0, 0.0)
    there, sand = 0.0, []
    for flag, seconds in zip(on, step, strict=True):
        kept = np.exp(-seconds / (3.0 if flag else 1.0))
        there = (kept * there + (1 - kept) * flag) * (seconds > 0)
        sand.append(there)
    table["sanding"] = on.astype(float)
    change = (1 + 1.2 * np.array(sand)) * np.exp(-0.2 * (on - 0.5))
    table["adhesion"] = change * curve(table["slip_ratio"]) + noise(draw, sigma=0.002)
    arrives = EFFECTS["sanding"](k=1.0, build_up=2.0, decay=1.0)
    wets = Memory(-0.1, 0.01, 0.5, 0.5, column="sanding")
    effect = Accepted(
        "sanding", ("sanding",), "sand", False, ("sanding",), (arrives, wets), 0.0005, 90.0
    )
    (shown,) = dependences(state_of(table, effect), seed=0)
    assert shown.column == "time since a step of sanding"
    assert 1.7 < shown.values[-1] <= 2.0
    last = (1 + 1.2 * (1 - np.exp(-shown.values[-1] / 3.0))) * np.exp(-0.2)
    assert shown.factor[-1] / shown.factor[0] == pytest.approx(last, rel=0.02)


@pytest.mark.parametrize(
    ("column", "unit"),
    [
        ("run_time_s", "s"),
        ("normal_load_N", "N"),
        ("wind_mps", "unit of the column"),
    ],
)
def test_the_unit_of_a_column(column, unit):
    assert unit_of(column) == unit


@pytest.mark.parametrize("time_s", ["goes on", "starts anew", "is not there"])
def test_a_drift_is_shown_over_the_time_that_the_campaign_has(time_s):
    draw = np.random.default_rng(6)
    table = campaign(draw)
    column = "time_s" if time_s == "goes on" else "run_order"
    time = table["time_s" if time_s == "goes on" else "run"].to_numpy()
    level = 1 + 0.3 * np.tanh(4 * (time / time.max() - 0.4))
    table["adhesion"] = level * curve(table["slip_ratio"]) + noise(draw, sigma=0.002)
    part = EFFECTS["drift"](k=0.2, centre=0.5, width=0.3, reference=0.5)
    if time_s == "starts anew":
        table["time_s"] -= 300.0 * table["run"]
    elif time_s == "is not there":
        table = table.drop(columns="time_s")
    rests_on = ("run",) if time_s == "is not there" else ("time_s",)
    effect = Accepted("drift", ("drift",), "time", False, rests_on, (part,), 0.0005, 90.0)
    (shown,) = dependences(state_of(table, effect), seed=0)
    assert (shown.column, shown.values.min(), shown.values.max()) == (column, 0.0, time.max())
    true = 1 + 0.3 * np.tanh(4 * (shown.values / time.max() - 0.4))
    np.testing.assert_allclose(shown.factor / shown.factor.mean(), true / true.mean(), atol=0.01)


def test_an_effect_with_a_memory_is_shown_once_it_has_settled():
    draw = np.random.default_rng(7)
    table = campaign(draw)
    table["adhesion"] = curve(table["slip_ratio"]) + noise(draw, sigma=0.002)
    (part,) = Memory.starts({"gust": table["gust"].to_numpy()})[:1]
    name = "covariate:gust"
    effect = Accepted(name, (name,), "gust", True, ("gust",), (part,), 0.0005, 90.0)
    state = state_of(table, effect)
    (shown,) = dependences(state, seed=0)
    (fitted,) = state.accepted[0].parts
    # Of a constant column the filtered one is the column itself.
    steady = fitted.k * (shown.values - fitted.reference) / fitted.scale
    np.testing.assert_allclose(np.log(shown.factor), steady, atol=1e-4)
    assert np.ptp(shown.values) == np.ptp(table["gust"])


def test_a_curve_that_falls_with_the_speed_is_shown_over_the_speed():
    draw = np.random.default_rng(8)
    table = campaign(draw)
    table["vehicle_speed_mps"] = draw.uniform(4.0, 20.0, 20)[table["run"]]

    def polach(slip, speed):
        """Polach 2005 with A = .4, B = .6 s/m, C = 90, kA = 1, kS = .4."""
        friction = 0.4 * (0.6 * np.exp(-0.6 * slip * speed) + 0.4)
        gradient = np.pi * 90.0 * slip / (4 * friction)
        return (2 * friction / np.pi) * (gradient / (1 + gradient**2) + np.arctan(0.4 * gradient))

    true = polach(table["slip_ratio"], table["vehicle_speed_mps"])
    table["adhesion"] = true + noise(draw, sigma=0.001)
    state = Selection(alone(table, "polach-falling", (0.4, 0.4, 0.6, 90.0, 0.4)))
    (shown,) = dependences(state, seed=0)
    assert (shown.effect, shown.column, shown.unit) == (
        "polach-falling",
        "vehicle_speed_mps",
        "m/s",
    )
    at_most = polach(table["slip_ratio"].max(), shown.values)
    np.testing.assert_allclose(shown.factor, at_most / at_most[0], atol=0.01)
    assert ((shown.low <= shown.factor) & (shown.factor <= shown.high)).all()
    assert at_most[-1] < 0.8 * at_most[0]


def test_the_band_of_a_curve_has_no_friction_that_rises_with_the_slip_velocity():
    draw = np.random.default_rng(9)
    table = campaign(draw)
    table["vehicle_speed_mps"] = draw.uniform(9.0, 10.0, 20)[table["run"]]
    table["adhesion"] = curve(table["slip_ratio"]) + noise(draw, sigma=0.02)
    state = Selection(alone(table, "polach-scaled", (0.4, 0.4, 0.6, 90.0, 0.4)))
    (shown,) = dependences(state, seed=0)
    # What is left of friction is at most all of it, however little the data determine it.
    assert (shown.high <= 1 + 1e-9).all()


@pytest.mark.parametrize("factor", [0.8, 1.0])
def test_the_curve_of_braking_is_shown_over_that_of_traction_where_it_differs(factor):
    draw = np.random.default_rng(10)
    table = campaign(draw, kind="both")
    own = np.where(table["slip_ratio"] < 0, factor, 1.0)
    table["adhesion"] = own * curve(table["slip_ratio"]) + noise(draw, sigma=0.002)
    shown = dependences(Selection(alone(table)), seed=0)
    if factor == 1.0:
        assert shown == ()
    else:
        (braking,) = shown
        assert (braking.effect, braking.column) == ("braking over traction", "slip_ratio")
        assert braking.values[braking.told] == braking.at_slip
        assert braking.high[braking.told] < 1
        largest = braking.values > 0.01
        np.testing.assert_allclose(braking.factor[largest], 0.8, atol=0.01)
        assert braking.high[largest].max() < 0.85


def test_braking_is_compared_with_what_the_law_adds_to_the_adhesion():
    """A curve with a departure of its own in braking may take from an offset what that has."""
    draw = np.random.default_rng(13)
    table = campaign(draw, kind="both")
    own = np.where(table["slip_ratio"] < 0, 0.8, 1.0)
    table["adhesion"] = own * curve(table["slip_ratio"]) + 0.02 + noise(draw, sigma=0.002)
    part = Constant(0.0, acts_on="offset")
    effect = Accepted("added", ("added",), "added", True, ("load",), (part,), 0.0005, 90.0)
    (braking,) = (one for one in dependences(state_of(table, effect), 0) if one.effect == BRAKING)
    whole = curve(braking.values)
    much = braking.values > 0.01
    expected = (0.8 * whole - 0.02) / (whole + 0.02)
    np.testing.assert_allclose(braking.factor[much], expected[much], atol=0.02)
    # Shown from a tenth of the largest adhesion on, which braking reaches at .037.
    least = 0.8 * curve(braking.values[:2]) - 0.02
    limit = 0.1 * (whole.max() + 0.02)
    assert 2 * least[0] - least[1] - 0.005 < limit < least[0] + 0.005


def test_a_curve_is_shown_where_it_depends_most_and_not_where_friction_has_fallen_at_all_speeds():
    """At slip 1 what is left of friction is the same at 4 and at 20 m/s, .4 of it."""
    draw = np.random.default_rng(11)
    table = campaign(draw)
    table["vehicle_speed_mps"] = draw.uniform(4.0, 20.0, 20)[table["run"]]
    table["slip_ratio"] *= 8
    slip, speed = table["slip_ratio"], table["vehicle_speed_mps"]
    left = 0.6 * np.exp(-3.0 * slip * speed) + 0.4
    rise = 90 * np.pi * slip / (4 * 0.4)
    polach = 0.8 / np.pi * (rise / (1 + rise**2) + np.arctan(0.4 * rise))
    table["adhesion"] = left * polach + noise(draw, sigma=0.001)
    state = Selection(alone(table, "polach-scaled", (0.4, 0.4, 3.0, 90.0, 0.4)))
    (shown,) = dependences(state, seed=0)
    ends = 0.6 * np.exp(-3.0 * shown.at_slip * shown.values[[0, -1]]) + 0.4
    assert shown.factor[shown.told] == pytest.approx(ends[1] / ends[0], abs=0.02)
    assert shown.at_slip < 0.3
    assert ends[1] < 0.75 * ends[0]
