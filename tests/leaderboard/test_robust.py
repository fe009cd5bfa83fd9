"""Disturbances: what each changes, that level 0 is the nominal run, and the rows of the track."""

from dataclasses import fields

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest

from adhesion_jax import library
from adhesion_jax.campaign.traction import WHOLE
from adhesion_jax.errors import InputError
from adhesion_jax.leaderboard import judging
from adhesion_jax.leaderboard.disturbances import (
    ALL,
    Disturbance,
    disturbances,
    over_all,
    with_worst,
)
from adhesion_jax.leaderboard.judging import Judging
from adhesion_jax.leaderboard.terms import SAMPLED, Field, Grid, timing_of
from adhesion_jax.leaderboard.tuning import TRIPLES, Tuning, points
from adhesion_jax.library.leaderboard import traction_leaderboard
from adhesion_jax.metrics.closed_loop import FIGURES
from adhesion_jax.traction.entrants import ENTRANTS
from adhesion_jax.traction.families import FAMILIES
from adhesion_jax.traction.loop import run
from adhesion_jax.traction.plants.reading import read_plant, shipped
from adhesion_jax.traction.sensors import Sensors
from adhesion_jax.traction.systems import SYSTEMS
from adhesion_jax.traction.systems.base import terms_of

SENSORS = Sensors(SYSTEMS["hxd1f"].noise, period=SAMPLED)
TERMS = terms_of(SYSTEMS["hxd1f"], read_plant(shipped()["hxd1f"]).plant, SENSORS)
METHOD = ENTRANTS["constant-slip"]
KEY = jax.random.key(3)
STEP = 2e-4


def loop_of(disturbance=None, method=METHOD):
    family = disturbance or FAMILIES["exponential"]
    return family.met(TERMS.loop(method, family.draw(KEY, STEP)))


def places(tree):
    """The numbers of a loop but for those of its rails, by place."""
    found, _ = jax.tree_util.tree_flatten_with_path(tree)
    return {
        jax.tree_util.keystr(path): np.asarray(leaf)
        for path, leaf in found
        if not jax.tree_util.keystr(path).startswith(".rails")
    }


#: The numbers that each level changes, with the factor or what is added.
CHANGES = {
    "radius": {".sensors.radius_error": 0.01},
    "count": {".sensors.count_error": 0.01},
    "speed": {".sensors.train_bias": 0.01},
    "noise": {".sensors.noise.motor": 0.02 * 1.01, ".sensors.noise.train": 0.005 * 1.01},
    "inertia": {".nominal.motor_inertia": 25 / 1.01, ".nominal.wheelset_inertia": 400 / 1.01},
    "load": {".nominal.axle_load": 30000 / 1.01},
    "lag": {".plant.torque_lag": 0.02},
    "dead_time": {".plant.dead_time": 0.01},
    "dip": {".dip": 0.01},
}


@pytest.mark.parametrize("name", CHANGES)
def test_a_disturbance_changes_what_it_says_and_nothing_else(name):
    before, after = places(loop_of(Disturbance())), places(loop_of(Disturbance(**{name: 0.01})))
    assert before.keys() == after.keys()
    changed = {place for place in before if (before[place] != after[place]).any()}
    assert changed == set(CHANGES[name])
    for place, value in CHANGES[name].items():
        np.testing.assert_allclose(after[place], value, rtol=1e-12)


def test_every_level_is_one_of_a_disturbance():
    levels = {field.name for field in fields(Disturbance)}
    assert levels == {*CHANGES, "hurry", "plant", "pulses"}


@pytest.mark.long
def test_a_disturbance_of_level_0_is_the_nominal_run_bit_for_bit():
    nominal, none = places(loop_of()), places(loop_of(Disturbance()))
    for place, value in nominal.items():
        np.testing.assert_array_equal(none[place], value, err_msg=place)
    grid = timing_of(TERMS, Grid(duration=0.5), "", METHOD, FAMILIES["exponential"])
    compiled = jax.jit(run, static_argnums=1)
    one, other = (
        compiled(loop, grid, KEY).segments[0] for loop in (loop_of(), loop_of(Disturbance()))
    )
    values = places(other)
    for place, value in places(one).items():
        np.testing.assert_array_equal(values[place], value, err_msg=place)


def test_hurried_rails_have_the_segments_of_the_others_in_a_fifth_of_the_time():
    calm, hurried = (Disturbance(hurry=n).draw(KEY, STEP) for n in (0, 4))
    told = jnp.asarray(5.0), jnp.asarray(False)
    steps = np.arange(0, 15000, 7)
    at = jax.vmap(lambda rails, step: rails.segment(step, *told), (None, 0))
    of_calm = at(calm, jnp.asarray(5 * steps))
    for turn in range(5):
        np.testing.assert_array_equal(at(hurried, jnp.asarray(steps + 15000 * turn)), of_calm)


def test_an_encoder_reads_the_last_period():
    """At constant speed the period is exact; while it rises, what is read is that of the past."""
    sensors = loop_of(Disturbance(pulses=80)).sensors
    speed, rate, step = 50.0, 100.0, 1e-4
    sensed = sensors.init(TERMS.plant, jnp.asarray([speed]), jnp.asarray(5.0))
    turn = jax.jit(lambda sensed, w: sensors.turn(sensed, w, step))
    for number in range(2000):
        w = speed + rate * max(number - 1000, 0) * step
        sensed = turn(sensed, jnp.asarray([w]))
        if number == 999:
            assert float(sensed.read[0]) == pytest.approx(speed, rel=1e-12)
    # A pulse takes 2 pi/80/60 = 1.3 ms: the mean of the last whole one ends up to another ago.
    late = (w - float(sensed.read[0])) / rate
    assert 0.5 * 1.3e-3 < late < 1.6 * 1.4e-3


def test_half_is_tuned_on_and_a_third_of_that_twists():
    tuned = [one for one in disturbances().values() if one.tuned_on]
    assert 2 * len(tuned) == len(disturbances())
    assert 3 * sum(one.disturbance.plant is not None for one in tuned) == len(tuned)
    names = {name: one.disturbance for name, one in disturbances().items() if one.tuned_on}
    field = Field(TERMS, None, {"one": METHOD})
    assert Tuning(field, names, 64, 0).each * len(names) == TRIPLES


@pytest.mark.thorough
def test_another_method_changes_no_row_and_all_disturbances_have_the_same_rails():
    entrants = {"first": METHOD, "second": ENTRANTS["perturb-and-observe"]}
    families = {name: disturbances()[name].disturbance for name in ("nominal", "dead-time-5ms")}
    grid = Grid(duration=0.5)
    timing = timing_of(TERMS, grid, "", METHOD, families["dead-time-5ms"])
    found = []
    for methods in (entrants, {"first": METHOD}):
        at = {name: points(one, 1)[0] for name, one in methods.items()}
        job = Judging(Field(TERMS, timing, methods), families, at, 4, 0)
        rows = pd.concat([judging.content(job, n).rows.to_pandas() for n in range(job.shards)])
        rows = rows.astype({"method": str, "rails": str, "segment": str})
        found.append(rows[rows["method"] == "first"].reset_index(drop=True))
    pd.testing.assert_frame_equal(*found, check_exact=True)
    rows = found[0][found[0]["segment"] == "1"]
    peaks = rows.pivot_table("peak_slip", index=["seed", "run"], columns="rails")
    np.testing.assert_array_equal(peaks["nominal"], peaks["dead-time-5ms"])


def test_rows_over_all_are_means_of_the_same_runs():
    figures = dict.fromkeys(FIGURES, 0.5)
    rows = [
        {"rails": rails, "method": "one", "seed": 0, "run": run, "segment": WHOLE}
        | figures
        | {"utilisation": value + 0.1 * run, "axle_torque_over_static": torque}
        for rails, value, torque in (("a", 0.5, np.nan), ("b", 0.7, 1.2))
        for run in range(2)
    ]
    found = over_all(pd.DataFrame(rows))
    np.testing.assert_allclose(found["utilisation"], [0.6, 0.7])
    np.testing.assert_allclose(found["axle_torque_over_static"], 1.2)
    assert set(found["rails"]) == {ALL}
    table = pd.DataFrame(
        [
            {"rails": rails, "method": "one", "worst": worst, "never95": never}
            for rails, worst, never in ((ALL, 0.6, np.nan), ("a", 0.5, 0.0), ("b", 0.7, 0.5))
        ]
    )
    np.testing.assert_allclose(
        with_worst(table).iloc[0][["worst", "never95"]].astype(float), [0.5, 0.25]
    )


@pytest.mark.thorough
def test_the_track_writes_its_table_map_and_report(tmp_path, monkeypatch):
    few = {name: disturbances()[name] for name in ("dead-time-10ms", "backlash")}
    monkeypatch.setattr(library.leaderboard, "disturbances", lambda: few)
    one, two = (
        traction_leaderboard(
            "constant-slip",
            track="robust",
            runs=2,
            budget=2,
            duration=1.0,
            workers=workers,
            out=out,
        )
        for workers, out in ((1, tmp_path / "one"), (2, tmp_path / "two"))
    )
    told = one.table.drop(columns=["microseconds"])
    pd.testing.assert_frame_equal(told, two.table.drop(columns=["microseconds"]), check_exact=True)
    assert set(told["rails"]) == {ALL, *few}
    of_all = told[told["rails"] == ALL].set_index("method")
    each = told[told["rails"] != ALL].groupby("method")
    np.testing.assert_allclose(of_all["utilisation"], each["utilisation"].mean()[of_all.index])
    twists = told["axle_torque_p95"].notna()
    assert set(told.loc[twists, "rails"]) == {ALL, "backlash"}
    read = pd.read_csv(tmp_path / "one" / "robustness.csv")
    assert read["method"].tolist() == told["method"].tolist()
    report = (tmp_path / "one" / "report.html").read_text(encoding="utf-8")
    assert "In the mean over" in report
    assert "torque begins 10 ms after its command" in report
    assert (tmp_path / "one" / "robustness.png").stat().st_size > 1000


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        ({"track": "hard"}, "There is no track hard; name nominal or robust."),
        ({"track": "robust", "rails": "film"}, "the robust track has its own train and rails"),
    ],
)
def test_what_the_track_cannot_do_is_refused_in_a_sentence(asked, told):
    with pytest.raises(InputError, match=told):
        traction_leaderboard("constant-slip", **asked)
