"""A log that online methods follow: against single updates, known switches, and each other."""

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest
from hypothesis import given as example
from hypothesis import strategies as st
from lanes import lanes

from adhesion_jax.curves.kiencke import Kiencke
from adhesion_jax.data import SHIPPED, read_measured, to_measured
from adhesion_jax.identifiers import IDENTIFIERS, Status
from adhesion_jax.measured import following
from adhesion_jax.measured.following import follow_log, known_of, refusal
from adhesion_jax.measured.log import initial_slope, to_log
from adhesion_jax.records import Record
from adhesion_jax.report.track.words import told
from adhesion_jax.scenarios.rails import KIENCKE_RAILS
from experiments.discovery_study.one_log import one_log

ONLINE = ("riv", "qp-qian2024-1", "rls-kiencke")

DRY, COMMON = KIENCKE_RAILS["dry"], KIENCKE_RAILS["common"]
A0 = 40.0


def adhesion_of(rail, slip):
    return float(rail.a0) * slip / (1 + rail.p1 * np.abs(slip) + rail.p2 * slip**2)


def sweeps(count, seed, rail=DRY, then=None, sigma=0.01, alike=0.0):
    """A log at 50 Hz: slip runs up and down to .2, the rail is another from the middle on."""
    random = np.random.default_rng(seed)
    time = 0.02 * np.arange(count)
    slip = 0.1 * (1 - np.cos(2 * np.pi * time / 3.7)) + 0.001
    clean = adhesion_of(rail, slip)
    if then is not None:
        clean = np.where(np.arange(count) < count // 2, clean, adhesion_of(then, slip))
    noise = sigma * np.sqrt(1 - alike**2) * random.normal(size=count)
    noise[0] = sigma * random.normal()
    for i in range(1, count):
        noise[i] += alike * noise[i - 1]
    return pd.DataFrame({"time_s": time, "slip_ratio": slip, "adhesion": clean + noise})


def log_of(table, wanted=False):
    return to_log(to_measured("log", table), wanted)


def followed(table, names, *slopes, form=following.NO_FORM):
    methods = {name: IDENTIFIERS[name] for name in names}
    return follow_log(methods, log_of(table), np.array(slopes or (A0,)), form)


def at(one, sample):
    """The row of the estimates that holds after that sample."""
    return one.estimates[one.estimates["sample"] <= sample].iloc[-1]


@pytest.mark.parametrize("name", lanes(ONLINE, 1, 2))
def test_the_scan_is_one_update_after_the_other(name):
    table, method = sweeps(150, 1), IDENTIFIERS[name]
    state = method.init(known_of(A0, 1.0), jax.random.key(0))
    update, estimate = jax.jit(method.update), jax.jit(method.estimate)
    every = jnp.ones(1, dtype=bool)
    told = []
    for slip, adhesion in zip(table["slip_ratio"], table["adhesion"], strict=True):
        record = Record(jnp.asarray([slip]), jnp.asarray([adhesion]), every, every, {})
        state = update(state, record)
        now = estimate(state)
        place = list(now.values).index("mu_max")
        told.append((now.values["mu_max"], now.values["slip_opt"], now.covariance[place, place]))
    mu_max, slip_opt, variance = np.array(told).T
    one = followed(table, [name])[name]
    rows = one.estimates
    assert list(rows["sample"]) == list(range(150))
    np.testing.assert_allclose(rows["mu_max"], mu_max, rtol=1e-9)
    np.testing.assert_allclose(rows["slip_opt"], slip_opt, rtol=1e-9)
    np.testing.assert_allclose(
        rows["mu_max_se"], one.widening * np.sqrt(variance), rtol=1e-6, atol=1e-12
    )


@pytest.mark.long
def test_chunks_change_nothing(monkeypatch):
    table, names = sweeps(300, 2, then=COMMON), ("riv", "rls-kiencke")
    whole = followed(table, names)
    monkeypatch.setattr(following, "CHUNK", 64)
    parts = followed(table, names)
    for name in names:
        pd.testing.assert_frame_equal(whole[name].estimates, parts[name].estimates, rtol=0, atol=0)
        assert whole[name][1:-1] == parts[name][1:-1]


@pytest.fixture(scope="module")
def switched():
    """Of 40 logs whose rail becomes another in the middle, the riv; noise white or correlated."""
    return {
        alike: [
            followed(sweeps(900, seed, DRY, COMMON, alike=alike), ["riv"])["riv"]
            for seed in range(40)
        ]
        for alike in (0.0, 0.6)
    }


@pytest.mark.thorough
@pytest.mark.parametrize("alike", [0.0, 0.6])
def test_the_largest_adhesion_is_in_its_band_before_and_after_a_switch(switched, alike):
    inside = {"before": 0, "after": 0}
    for one in switched[alike]:
        for when, sample, rail in (("before", 449, DRY), ("after", 899, COMMON)):
            row, true = at(one, sample), float(rail.peak({}).adhesion)
            assert row["status"] == Status.TRUSTED
            assert abs(row["mu_max"] - true) < 0.05 * true
            inside[when] += abs(row["mu_max"] - true) < following.QUANTILE * row["mu_max_se"]
    # Of 40 with a chance of .95 at least 33 but for once in 1000.
    assert min(inside.values()) >= 33, inside
    assert following.QUANTILE == 1.96


@pytest.mark.thorough
def test_correlated_noise_widens_the_bands(switched):
    for alike, widening in ((0.0, 1.0), (0.6, 2.0)):
        found = np.array([one.correlation for one in switched[alike]])
        assert np.median(found) == pytest.approx(alike, abs=0.05)
        wide = np.array([one.widening for one in switched[alike]])
        assert np.median(wide) == pytest.approx(widening, abs=0.15)


@pytest.mark.thorough
def test_a_method_that_knows_of_the_noise_has_its_own_bands():
    """Its estimate of the correlation is not taken into account twice."""
    inside = 0
    for seed in range(30):
        one = followed(sweeps(600, seed, alike=0.6), ["bank-kiencke"])["bank-kiencke"]
        assert one.correlation > 0.25  # of what it mispredicts, which is less than the noise
        assert one.widening == 1.0
        row = at(one, 599)
        true = float(DRY.peak({}).adhesion)
        inside += abs(row["mu_max"] - true) < following.QUANTILE * row["mu_max_se"]
        assert row["mu_max_se"] < 0.02 * true
    # Of 30 with a chance of .95 at least 24 but for once in 1000.
    assert inside >= 24


@pytest.mark.long
def test_a_method_that_looks_for_the_slope_itself_is_not_misled_by_the_one_told():
    table = sweeps(600, 4)
    one = followed(table, ["kiencke-free", "riv"], 0.6 * A0)
    true = float(DRY.peak({}).adhesion)
    row = at(one["kiencke-free"], 599)
    assert abs(row["mu_max"] - true) < 3 * row["mu_max_se"] < 0.02 * true
    assert abs(at(one["riv"], 599)["mu_max"] - true) > 0.02 * true


def test_a_reset_is_marked_where_it_occurs_and_nowhere_else():
    for seed in range(3):
        one = followed(sweeps(900, seed, DRY, COMMON), ["riv"])["riv"]
        rows = one.estimates
        for sample, rail in ((449, DRY), (899, COMMON)):
            row, true = at(one, sample), float(rail.peak({}).adhesion)
            assert abs(row["mu_max"] - true) < 3.5 * row["mu_max_se"]
        resets = rows["sample"][rows["reset"]].to_numpy()
        assert one.resets == resets.size == rows["resets"].iloc[-1]
        assert resets.size >= 1
        assert np.all((resets >= 450) & (resets < 500))
        assert rows["resets"].iloc[449] == 0
    # A rail that stays as it is makes no reset.
    assert followed(sweeps(900, 3), ["riv"])["riv"].resets == 0


def test_forgetting_follows_a_switch():
    one = followed(sweeps(1200, 5, DRY, COMMON), ["rls-kiencke"])["rls-kiencke"]
    for sample, rail in ((599, DRY), (1199, COMMON)):
        row, true = at(one, sample), float(rail.peak({}).adhesion)
        assert abs(row["mu_max"] - true) < max(3 * row["mu_max_se"], 0.02 * true)
    assert one.resets == 0
    assert one.trusted == (one.estimates["status"] == Status.TRUSTED).sum()


@pytest.mark.long
def test_the_standard_error_has_its_three_parts():
    table, form = sweeps(200, 6), {"mu_max": 0.02, "slip_opt": 0.1}
    below, above = A0 * np.exp(-0.1), A0 * np.exp(0.1)
    one = followed(table, ["riv"], A0, below, above, form=form)["riv"].estimates.iloc[-1]
    alone, *sides = (
        followed(table, ["riv"], slope)["riv"].estimates.iloc[-1] for slope in (A0, below, above)
    )
    assert one["mu_max"] == pytest.approx(alone["mu_max"], rel=1e-9)
    for name in ("mu_max", "slip_opt"):
        half = (sides[1][name] - sides[0][name]) / 2
        parts = (alone[f"{name}_se"], half, form[name] * alone[name])
        assert min(map(abs, parts)) > 0
        assert one[f"{name}_se"] == pytest.approx(np.linalg.norm(parts), rel=1e-6)


def test_where_the_lanes_give_up_the_past_apart_the_band_is_that_before():
    """The noise is little, and a slope 20 % off sees a reset sooner: the lanes differ by the rail.

    Held against the three slopes one by one: between the first reset and the last.
    """
    table = sweeps(400, 3, then=COMMON, sigma=0.004)
    slopes = A0, 0.8 * A0, 1.25 * A0
    alone = [followed(table, ["riv"], slope)["riv"].estimates for slope in slopes]
    resets = [one["sample"][one["reset"]].min() for one in alone]
    assert max(resets) > min(resets)
    one = followed(table, ["riv"], *slopes)["riv"].estimates
    relative = one["mu_max_se"] / one["mu_max"]
    apart = (one["sample"] >= min(resets)) & (one["sample"] < max(resets))
    lanes_apart = np.abs(alone[2]["mu_max"] - alone[1]["mu_max"]) / (2 * alone[0]["mu_max"])
    assert np.ptp(lanes_apart[apart]) > 0.02
    assert np.ptp(relative[apart]) < 1e-3


@pytest.mark.parametrize(("dries", "is_told"), [(0.9, True), (0.0, False)])
def test_a_rail_that_changes_slowly_is_told_by_who_lags_behind_it(dries, is_told):
    table = sweeps(3000, 5)
    table["adhesion"] *= 1 + dries * table["time_s"] / table["time_s"].max()
    log = log_of(table)
    ends = followed(table, ["riv", "rls-kiencke"])
    words = " ".join(told(log, "", initial_slope(log, None), ends).split())
    assert ("errors of prediction of riv keep their sign far longer" in words) == is_told


def test_an_adhesion_above_a_trusted_estimate_was_reached_before_the_rail_changed():
    rows = {name: np.zeros(3) for name in following._TOLD}
    rows |= {"sample": np.arange(3), "mu_max": np.full(3, 0.2), "mu_max_se": np.full(3, 0.005)}
    rows |= {"reached": np.array([0.205, 0.28, 0.28]), "fall": np.full(3, np.nan)}
    rows["status"] = np.array([0, 0, Status.TRUSTED.value + 1])
    log = log_of(sweeps(100, 1))
    table = following._table(rows, log, 1.0, following.NO_FORM, 1.0)
    assert Status.TRUSTED.value == 0
    assert table["at_least"].all()
    np.testing.assert_allclose(table["reached"], [0.205, 0.0, 0.28])


def test_braking_is_traction_turned():
    table = sweeps(200, 7)
    turned = table.assign(slip_ratio=-table["slip_ratio"], adhesion=-table["adhesion"])
    forward, back = (followed(one, ONLINE) for one in (table, turned))
    for name in ONLINE:
        pd.testing.assert_frame_equal(forward[name].estimates, back[name].estimates)


def test_a_sample_that_is_not_finite_is_left_out_and_counted():
    log = log_of(sweeps(200, 8))
    broken = log._replace(adhesion=np.where(np.arange(200) == 50, np.nan, log.adhesion))
    without = log._replace(used=np.delete(log.used, 50), starts=np.delete(log.starts, 50))
    methods = {name: IDENTIFIERS[name] for name in ONLINE}
    for name, one in follow_log(methods, broken, np.array([A0])).items():
        assert one.skipped == one.estimates["skipped"].iloc[-1] == 1
        assert at(one, 49)["skipped"] == 0
        other = follow_log({name: methods[name]}, without, np.array([A0]))[name]
        last, same = at(one, 199), at(other, 199)
        assert last["mu_max"] == pytest.approx(same["mu_max"], rel=1e-9)


def test_progress_counts_every_sample():
    done = []
    log = log_of(sweeps(150, 1))
    follow_log({"riv": IDENTIFIERS["riv"]}, log, np.array([A0]), report=done.append)
    assert sum(done) == 150


@example(st.data())
def test_the_checkpoints_and_the_first_marks_between_them_are_kept(data):
    count = data.draw(st.integers(1, 60))
    flags = st.lists(st.booleans(), min_size=count, max_size=count)
    told = {
        "sample": np.arange(count),
        "reset": np.array(data.draw(flags)),
        "changed": np.array(data.draw(flags)),
    }
    chosen = np.array(sorted(data.draw(st.sets(st.integers(0, count - 1), min_size=1))))
    kept = set(following._rows(told, chosen)["sample"])
    expected = set(chosen)
    for mark in ("reset", "changed"):
        held: dict[int, int] = {}
        for sample in np.flatnonzero(told[mark]):
            interval = int(np.sum(chosen < sample))
            held[interval] = held.get(interval, 0) + 1
            if held[interval] <= 4:
                expected.add(sample)
    assert kept == expected
    # What is chosen of parts is chosen again of the whole.
    cut = data.draw(st.integers(0, count))
    parts = [
        following._rows({name: one[part] for name, one in told.items()}, chosen)
        for part in (slice(cut), slice(cut, None))
    ]
    joined = {name: np.concatenate([part[name] for part in parts]) for name in told}
    assert set(following._rows(joined, chosen)["sample"]) == expected


def test_what_a_method_is_told_holds_every_rail():
    for rail in KIENCKE_RAILS.values():
        known = known_of(float(rail.a0), 1.0)
        values = np.array([rail.p1, rail.p2])
        assert np.all((known.lower < values) & (values < known.upper))
    start = known_of(100.0, 1.0).curve.peak({})
    assert (float(start.slip), float(start.adhesion)) == pytest.approx((0.1, 0.3))
    # As a velocity the same slips are ten times as large.
    start = known_of(10.0, 10.0).curve.peak({}, 10.0)
    assert (float(start.slip), float(start.adhesion)) == pytest.approx((1.0, 0.3))


def test_who_cannot_follow_a_log_says_why():
    refused = {name for name, one in IDENTIFIERS.items() if refusal(one) is not None}
    assert {"ml-exact", "ls-kiencke", "rls-slope"} <= refused
    assert not {*ONLINE, "qp-bias-compensated", "rls-kiencke-variable"} & refused
    assert "here samples come one at a time" in refusal(IDENTIFIERS["ml-exact"])


# --- the order of a log, and what of it is used


def test_rows_without_time_are_followed_as_they_stand():
    log = to_log(read_measured(SHIPPED["eurosprinter"].path))
    assert log.time is None
    np.testing.assert_array_equal(log.used, np.arange(163))
    assert "in the order of the rows" in log.sentences[0]


def test_runs_that_stand_out_of_order_are_followed_in_time():
    table = sweeps(200, 1)
    runs = pd.concat([table[100:].assign(run="b"), table[:100].assign(run="a")])
    log = log_of(runs)
    np.testing.assert_array_equal(log.time, table["time_s"])
    np.testing.assert_array_equal(log.slip, table["slip_ratio"])
    assert list(np.flatnonzero(log.starts)) == [0, 100]
    assert log.sentences[0] == "The samples are followed in the order of time."


def test_runs_with_clocks_of_their_own_are_followed_one_after_the_other():
    table = sweeps(100, 1)
    log = log_of(pd.concat([table.assign(run="b"), table.assign(run="a")]))
    np.testing.assert_allclose(log.time, 0.02 * np.arange(200), atol=1e-9)
    np.testing.assert_array_equal(log.slip[100:], log.slip[:100])
    assert "a clock of its own" in log.sentences[0]


def test_a_gap_in_time_is_marked():
    table = sweeps(100, 1)
    late = table.assign(time_s=np.where(np.arange(100) < 40, 0.0, 60.0) + table["time_s"])
    assert list(np.flatnonzero(log_of(late).starts)) == [0, 40]


@pytest.fixture(scope="module")
def locomotive():
    return one_log(seed=1, wheel_speed_noise=0.01)


def test_of_a_log_that_hardly_slips_events_alone_are_used(locomotive):
    log = log_of(locomotive.train, None)
    assert len(log.events) == 5
    assert log.slip.size == 3000
    assert 0.05 < log.used.size / 3000 < 0.12
    # Where the noise of the wheel speed makes a tenth of the slip or more, nothing is used.
    speed = locomotive.train["vehicle_speed_mps"].to_numpy()[log.used]
    assert np.all(np.abs(log.slip[log.used]) * speed > 4 * 0.01)
    noise = float(log.sentences[2].split("scatters by ")[1].split(" m/s")[0])
    assert noise == pytest.approx(0.01, rel=0.15)
    assert not log_of(locomotive.train, False).events.size


def test_the_noise_of_micro_slip_is_kept_from_the_methods(locomotive):
    """Between the events the noise of the slip looks like a curve with its peak there."""
    true = float(locomotive.curve.peak({}).adhesion)
    events, whole = (log_of(locomotive.train, wanted) for wanted in (None, False))
    slope = initial_slope(events)
    riv = {"riv": IDENTIFIERS["riv"]}
    found, spoilt = (
        follow_log(riv, log, slope.plausible)["riv"].estimates.iloc[-1]["mu_max"]
        for log in (events, whole)
    )
    assert found == pytest.approx(true, rel=0.02)
    assert abs(spoilt - true) > 0.2 * true


def test_the_initial_slope_is_that_of_the_curve():
    truth = Kiencke(a0=150.0, p1=450.0, p2=1700.0)
    errors = []
    for seed in range(6):
        found = initial_slope(log_of(sweeps(400, seed, truth)))
        errors.append((found.value - 150.0) / found.standard_error)
        assert (found.value, found.standard_error) == found.fitted
        below, above = found.plausible[1:]
        assert below < found.value < above
        assert below * above == pytest.approx(found.value**2)
    assert np.abs(errors).max() < 3.5
    # The form is right: what the curve misses is less than the noise of the peak.
    assert found.form["mu_max"] < float(found.fit.mu_max_se / found.fit.peak.adhesion)


def test_a_slope_that_is_given_is_taken_as_exact():
    found = initial_slope(log_of(sweeps(400, 1)), 30.0)
    assert list(found.plausible) == [30.0]
    assert found.fitted[0] == pytest.approx(A0, rel=0.1)


def test_the_band_allows_for_the_form_of_the_curve(locomotive):
    """Truth is Burckhardt's curve, and the methods have Kiencke's."""
    peak = locomotive.curve.peak({})
    slope = initial_slope(log_of(locomotive.train, None))
    for name, true in (("mu_max", peak.adhesion), ("slip_opt", peak.slip)):
        alone = {"mu_max": slope.alone.adhesion, "slip_opt": slope.alone.slip}[name]
        whole = {"mu_max": slope.fit.peak.adhesion, "slip_opt": slope.fit.peak.slip}[name]
        assert abs(whole - true) < abs(alone - true)
        assert slope.form[name] == pytest.approx(abs(whole / alone - 1))
    riv = {"riv": IDENTIFIERS["riv"]}
    one = follow_log(riv, log_of(locomotive.train, None), slope.plausible, slope.form)["riv"]
    last = one.estimates.iloc[-1]
    for name, true in (("mu_max", peak.adhesion), ("slip_opt", peak.slip)):
        assert abs(last[name] - true) < following.QUANTILE * last[f"{name}_se"]


@pytest.mark.thorough
def test_a_long_log_is_thinned_for_the_slope_over_all_its_slips():
    random = np.random.default_rng(0)
    slip = np.where(random.random(50_000) < 0.01, random.uniform(0, 0.2, 50_000), 0.004)
    table = pd.DataFrame({"slip_ratio": slip, "adhesion": adhesion_of(DRY, slip)})
    found = initial_slope(log_of(table))
    assert found.samples <= 60 * 40
    assert found.value == pytest.approx(A0, rel=1e-3)
