"""Methods on equal terms: seeds, processes, promises, failures, and the table."""

from importlib import import_module
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest

from adhesion_jax.campaign.keys import noise_keys
from adhesion_jax.campaign.pool import Processes
from adhesion_jax.campaign.traction import WHOLE
from adhesion_jax.errors import InputError
from adhesion_jax.files import write_table
from adhesion_jax.leaderboard import judging, terms, tuning
from adhesion_jax.leaderboard.judging import SEEDS, Judging, keys_of, shown_of
from adhesion_jax.leaderboard.runs import TILE
from adhesion_jax.leaderboard.table import COLUMNS, Known, board_of, table_of, with_rows
from adhesion_jax.leaderboard.terms import SAMPLED, Field, Grid, Versions, timing_of, versions_of
from adhesion_jax.leaderboard.tuning import TRIPLES, Tuning, points, tuned
from adhesion_jax.metrics.closed_loop import FIGURES
from adhesion_jax.report.leaderboard.page import verdict, when
from adhesion_jax.traction.entrants import ENTRANTS, sought
from adhesion_jax.traction.families import FAMILIES
from adhesion_jax.traction.plants.reading import read_plant, shipped
from adhesion_jax.traction.seekers.base import Seeker
from adhesion_jax.traction.sensors import Sensors
from adhesion_jax.traction.signals import Reference
from adhesion_jax.traction.systems import SYSTEMS
from adhesion_jax.traction.systems.base import terms_of

RAILS = "exponential"
FAMILY = FAMILIES[RAILS]
TUNING_SEED = 2026
SYSTEM = SYSTEMS["hxd1f"]
SENSORS = Sensors(SYSTEM.noise, period=SAMPLED)
TERMS = terms_of(SYSTEM, read_plant(shipped()["hxd1f"]).plant, SENSORS)

#: The first segment of a run alone.
GRID = Grid(duration=1.2)


class LookUp(Seeker):
    """Knows the runs of tuning by the noise of their first sample, and the best slip of each."""

    speeds: jax.Array
    slips: jax.Array

    def init(self, nominal, signals):
        return jnp.zeros_like(signals.slip)

    def update(self, state, nominal, signals, period):
        known = jnp.argmin(jnp.abs(self.speeds - signals.train_speed))
        slip = jnp.where(signals.time < period / 2, self.slips[known], state)
        return slip, Reference(slip, jnp.zeros_like(slip))


class Failing(Seeker):
    """Asks for what is no number where the rail is good."""

    def update(self, state, nominal, signals, period):
        slip = jnp.where(signals.adhesion > 0.2, jnp.nan, 0.1 * jnp.ones_like(signals.slip))
        return state, Reference(slip, jnp.zeros_like(slip))


def look_up():
    """What plays back in each of the runs of tuning what is best there."""
    speeds, slips = [], []
    for key in noise_keys(TUNING_SEED, RAILS, jnp.arange(TRIPLES)):
        of_rails, of_noise = jax.random.split(key)
        surface = FAMILY.draw(of_rails, GRID.step).surface(jnp.asarray(0))
        slips.append(surface.peak(TERMS.train_speed).slip)
        drawn = TERMS.sensors.draw(jax.random.fold_in(of_noise, 0), 1, 1)[0, -1]
        speeds.append(TERMS.train_speed + TERMS.sensors.noise.train * drawn)
    return sought(LookUp(jnp.stack(speeds), jnp.stack(slips)))


def field_of(**entrants):
    first = next(iter(entrants))
    return Field(TERMS, timing_of(TERMS, GRID, first, entrants[first], FAMILY), entrants)


def at_middle(field):
    return {name: points(one, 1)[0] for name, one in field.entrants.items()}


def judged(field, runs=40, seed=0, at=None):
    """The rows of all shards, and the shards."""
    job = Judging(field, {RAILS: FAMILY}, at or at_middle(field), runs, seed)
    found = [judging.content(job, number) for number in range(job.shards)]
    rows = pd.concat([one.rows.to_pandas() for one in found], ignore_index=True)
    return rows.astype({"method": str, "rails": str, "segment": str}), job, found


def known(promised=np.nan, error=np.nan, told=False):
    return Known(told, promised, error, "", 0.1, 8)


CONSTANT = ENTRANTS["constant-slip"]
VERSIONS = {RAILS: Versions("a", "b", "c")}


@pytest.fixture(scope="module")
def alone():
    return judged(field_of(constant=CONSTANT))


@pytest.mark.thorough
def test_another_method_changes_no_row_of_the_others(alone):
    rows, *_ = judged(field_of(first=sought(Failing()), constant=CONSTANT))
    same = rows[rows["method"] == "constant"].reset_index(drop=True)
    pd.testing.assert_frame_equal(same, alone[0], check_exact=True)


@pytest.mark.thorough
def test_processes_give_the_numbers_of_one(alone):
    rows, job, _ = alone
    work = [(job._replace(runs=90), number) for number in range(3)]
    with Processes(2).mapped(judging.content, work) as results:
        found = pd.concat([one.rows.to_pandas() for one in results], ignore_index=True)
    first = found.iloc[: len(rows)].astype({"method": str, "rails": str, "segment": str})
    pd.testing.assert_frame_equal(first, rows, check_exact=True)
    assert len(found) == 90 * SEEDS * len(rows) // (40 * SEEDS)


def test_runs_have_their_keys_from_seed_rails_and_number_alone():
    few, many = (keys_of(5, RAILS, np.arange(count)) for count in (8, TILE))
    assert (jax.random.key_data(few) == jax.random.key_data(many)[:8]).all()
    # Run 1 of the third seed is run 1 of a board that begins with it.
    third = keys_of(7, RAILS, np.arange(TILE))
    assert (jax.random.key_data(many)[SEEDS + 2] == jax.random.key_data(third)[SEEDS]).all()
    assert len(np.unique(jax.random.key_data(many), axis=0)) == TILE


@pytest.mark.long
def test_a_step_is_short_enough_for_the_steepest_of_many_rails():
    twisting = terms_of(SYSTEM, read_plant(shipped()["hxd1f_twist"]).plant, SENSORS)
    timing_of(twisting, GRID, "constant", CONSTANT, FAMILY)
    # The first rail that is drawn would allow .47 ms.
    longer = GRID._replace(step=1e-3 / 3)
    with pytest.raises(InputError, match=r"^constant cannot be judged: --step 0.000333333 s is"):
        timing_of(twisting, longer, "constant", CONSTANT, FAMILY)
    timing_of(TERMS, longer, "constant", CONSTANT, FAMILY)
    with pytest.raises(InputError, match=r"those of 8 axles of a locomotive, and the plant has 1"):
        timing_of(TERMS, GRID, "constant", CONSTANT, FAMILIES["axles"])


def test_points_are_those_of_one_sequence_in_the_unit_cube():
    method = ENTRANTS["perturb-and-observe"]
    found = points(method, 64)
    np.testing.assert_array_equal(found[:11], points(method, 11))
    np.testing.assert_array_equal(found[:, :2], points(CONSTANT, 64)[:, :2])
    # A scrambled Sobol sequence has one of 64 points in each 64th of every axis.
    for axis in found.T:
        assert sorted((64 * axis).astype(int)) == [*range(64)]


def test_a_step_is_checked_alike_by_a_program_that_another_process_has_kept():
    method = "constant-slip", ENTRANTS["constant-slip"]
    first = timing_of(TERMS, GRID, *method, FAMILY)
    terms._surfaces.programs.clear()  # as at the start of a process
    assert timing_of(TERMS, GRID, *method, FAMILY) == first


def test_a_shard_has_a_row_for_each_run_and_segment(alone):
    rows, job, found = alone
    assert len(rows) == 40 * SEEDS * 4
    assert rows["seed"].unique().tolist() == [0, 1, 2]
    assert rows["segment"].unique().tolist() == ["1", "2", "3", WHOLE]
    first = rows[rows["segment"] == "1"]
    whole = rows[rows["segment"] == WHOLE]
    assert rows.loc[rows["segment"] == "2", [*FIGURES]].isna().all(axis=None)
    np.testing.assert_array_equal(first["utilisation"], whole["utilisation"])
    # The true peak of each run is that of its rail.
    for _, row in first.iloc[:5].iterrows():
        lane = np.array([SEEDS * row["run"] + row["seed"]])
        rails = FAMILY.draw(jax.random.split(keys_of(0, RAILS, lane)[0])[0], GRID.step)
        peak = rails.surface(jnp.asarray(0)).peak(jnp.asarray(5.0))
        assert row["peak_slip"] == pytest.approx(float(peak.slip), rel=1e-12)
        assert row["peak_adhesion"] == pytest.approx(float(peak.adhesion), rel=1e-12)
    shown = shown_of(job, [one.arrays for one in found])[RAILS, "constant"]
    used = np.sort(whole["utilisation"])[::-1]
    np.testing.assert_array_equal(shown.utilisation, used[[0, (len(used) - 1) // 2, -1]])


def test_tuning_keeps_the_configuration_with_the_largest_mean():
    job = Tuning(field_of(constant=CONSTANT), {RAILS: FAMILY}, 8, TUNING_SEED)
    assert [job.runs_of(number) for number in range(job.shards)] == [128, 64]
    found = [tuning.content(job, number).arrays for number in range(job.shards)]
    best = tuned(job, found)["constant"]
    of_run = np.concatenate([one["utilisation"] for one in found]).reshape(8, TRIPLES)
    assert best.promised == of_run.mean(axis=1).max()
    place = of_run.mean(axis=1).argmax()
    np.testing.assert_array_equal(best.point, points(CONSTANT, 8)[place])
    assert best.cost.microseconds > 0
    # A slew limit remembers the slip of the one axle, and the other parts nothing.
    assert best.cost.state_bytes == 8
    assert best.promised_se == pytest.approx(of_run[place].std(ddof=1) / np.sqrt(TRIPLES))


@pytest.mark.thorough
def test_what_has_learned_the_rails_of_tuning_promises_more_than_it_holds():
    field = field_of(look_up=look_up())
    job = Tuning(field, {RAILS: FAMILY}, 1, TUNING_SEED)
    best = tuned(job, [tuning.content(job, 0).arrays])["look_up"]
    rows, *_ = judged(field, at={"look_up": best.point})
    told = {"look_up": known(best.promised, best.promised_se)}
    row = table_of(rows, told, VERSIONS, RAILS).iloc[0]
    assert row["utilisation"] < best.promised
    assert row["promised_z"] > 3
    # An honest method keeps its promise.
    job = job._replace(field=field_of(constant=CONSTANT), budget=4)
    best = tuned(job, [tuning.content(job, 0).arrays])["constant"]
    rows, *_ = judged(job.field, at={"constant": best.point})
    row = table_of(
        rows, {"constant": known(best.promised, best.promised_se)}, VERSIONS, RAILS
    ).iloc[0]
    assert row["promised_z"] < 3


@pytest.mark.thorough
def test_a_method_that_fails_is_counted_and_not_ranked(alone):
    rows, *_ = judged(field_of(failing=sought(Failing())))
    both = pd.concat([alone[0], rows], ignore_index=True)
    found = table_of(both, {"constant": known(), "failing": known()}, VERSIONS, RAILS)
    found = found.set_index("method")
    fails = int(rows.loc[rows["segment"] == WHOLE, "utilisation"].isna().sum())
    assert 0 < fails < 40 * SEEDS
    assert found.loc["failing", "failed"] == fails
    assert found.loc["failing", "remark"] == f"no number in {fails} of {40 * SEEDS} runs"
    assert pd.isna(found.loc["failing", "rank"])
    assert np.isfinite(found.loc["failing", "utilisation"])
    assert found.loc["constant", "rank"] == 1
    assert found.loc["constant", "failed"] == 0


def made_up(seed=3, runs=30, **levels):
    """Rows of runs with made-up figures: what the tables of methods are computed from."""
    draw = np.random.default_rng(seed)
    shared = draw.normal(0, 0.02, (SEEDS, runs))
    rows = []
    for method, level in levels.items():
        for one in range(SEEDS):
            for run in range(runs):
                for segment in ("1", "2", WHOLE):
                    value = level + shared[one, run] + draw.normal(0, 1e-3)
                    t95 = np.nan if segment == "1" and run < 6 else 0.1 * (run + 1)
                    figures = dict.fromkeys(FIGURES, value) | {
                        "t95": t95,
                        "never95": float(np.isnan(t95)),
                        "torque_variation": 10 * level,
                    }
                    rows.append(
                        {"rails": RAILS, "method": method, "seed": one, "run": run}
                        | {"segment": segment, **figures}
                    )
    return pd.DataFrame(rows)


def test_the_table_is_that_of_the_runs():
    rows = made_up(good=0.9, poor=0.6)
    table = table_of(rows, {"good": known(), "poor": known()}, VERSIONS, RAILS)
    assert [name for name in table if not name.endswith("_se")] == [*COLUMNS]
    poor = table.set_index("method").loc["poor"]
    whole = rows[rows["segment"] == WHOLE].pivot_table(
        index=["seed", "run"], columns="method", values="utilisation"
    )
    apart = whole["poor"] - whole["good"]
    assert poor["difference"] == pytest.approx(apart.mean())
    assert poor["difference_se"] == pytest.approx(apart.sem())
    # The rails that both share cancel.
    assert poor["difference_se"] < 0.2 * poor["utilisation_se"]
    assert poor["utilisation"] == pytest.approx(whole["poor"].mean())
    assert poor["worst"] == whole["poor"].min()
    # Six of thirty first segments never hold again: the 90th of 100 times is infinite.
    assert poor["never95"] == pytest.approx(0.1)
    assert poor["t95_median"] == pytest.approx(1.8)
    assert poor["t95_p90"] == pytest.approx(3.0)
    assert table["method"].tolist() == ["good", "poor"]
    assert table["rank"].tolist() == [1, 2]
    # Poor has less torque variation, so that good is no better in every respect.
    assert table["dominated_by"].tolist() == ["", ""]


def test_a_method_is_dominated_by_one_that_is_better_in_every_respect():
    rows = made_up(good=0.9, poor=0.6)
    of_poor = rows["method"] == "poor"
    rows.loc[of_poor, ["torque_variation", "slip_energy_share"]] = 99.0
    table = table_of(rows, {"good": known(), "poor": known()}, VERSIONS, RAILS)
    assert table["dominated_by"].tolist() == ["", "good"]
    # What is told the optimum dominates nobody, and has no place.
    table = table_of(rows, {"good": known(told=True), "poor": known()}, VERSIONS, RAILS)
    assert table["method"].tolist() == ["poor", "good"]
    assert table["dominated_by"].tolist() == ["", ""]
    assert table["rank"].tolist() == [1, pd.NA]


@pytest.mark.parametrize("other", [True, False])
def test_rows_of_another_version_are_not_ranked(other, tmp_path):
    here = table_of(made_up(good=0.9), {"good": known()}, VERSIONS, RAILS)
    versions = {RAILS: Versions("a", "b", "other" if other else "c")}
    both = dict.fromkeys(("poor", "good"), known())
    write_table(
        tmp_path / "board.csv", table_of(made_up(poor=0.6, good=0.95), both, versions, RAILS)
    )
    table = with_rows(here, board_of(tmp_path / "board.csv"))
    assert table["method"].tolist() == ["good", "poor"]
    assert table["utilisation"].iloc[0] == here["utilisation"].iloc[0]
    assert table["remark"].tolist() == ["", "of another version" if other else ""]
    assert table["rank"].isna().tolist() == [False, other]
    assert table["dominated_by"].tolist() == ["", ""]
    # The difference of another board is from a run that is not in this one.
    assert table["difference"].isna().tolist() == [False, True]


def test_versions_change_with_what_they_are_of():
    first = versions_of(TERMS, GRID, FAMILY)
    assert versions_of(TERMS, GRID, FAMILY) == first
    other = versions_of(TERMS, GRID._replace(step=1e-4), FAMILIES["polach"])
    assert other.plant != first.plant
    assert other.rails != first.rails
    assert other.metrics == first.metrics


@pytest.mark.parametrize(
    ("module", "of"),
    [
        ("traction.loop", "plant"),
        ("traction.integration", "plant"),
        ("traction.sensors", "plant"),
        ("traction.plants.base", "plant"),
        ("traction.families.base", "rails"),
        ("traction.families.by_segment", "rails"),
        ("traction.rails", "rails"),
        ("metrics.closed_loop", "metrics"),
    ],
)
def test_a_version_changes_with_the_source_that_its_numbers_depend_on(module, of, monkeypatch):
    before, read = versions_of(TERMS, GRID, FAMILY), Path.read_bytes
    changed = Path(import_module(f"adhesion_jax.{module}").__file__)
    monkeypatch.setattr(
        Path, "read_bytes", lambda path: read(path) + (b"#" if path == changed else b"")
    )
    after = versions_of(TERMS, GRID, FAMILY)
    assert {name for name in Versions._fields if getattr(before, name) != getattr(after, name)} == {
        of
    }


def test_the_verdict_tells_the_share_of_a_method_once():
    rows = [
        {
            "method": name,
            "utilisation": share,
            "torque_variation": torque,
            "slip_energy_share": slip,
        }
        for name, share, torque, slip in (("most", 0.99, 2.0, 0.1), ("calm", 0.97, 1.0, 0.2))
    ]
    table = pd.DataFrame(rows).assign(
        rails="r", remark="", dominated_by="", worst=0.9, utilisation_se=0.001, failed=0
    )
    words = verdict(table.assign(promised_z=0.0, seeds_apart=0.0), "r")
    assert words.startswith("On r rails, most and calm are not dominated: ")
    assert words.count("99.00 ± 0.10 %") == words.count("97.00 ± 0.10 %") == 1
    assert words.endswith("“most” has the least slip energy of them.")


def test_the_report_tells_in_kilonewton_what_rails_hold_and_what_is_left_of_it():
    even = dict.fromkeys(("torque_variation", "slip_energy_share", "microseconds", "worst"), 1.0)
    table = pd.DataFrame(
        [
            {"method": name, "rails": "r", "remark": "", "utilisation": share, "utility_3": share}
            | {"pull": 400 * share, "pull_share": share, **even}
            for name, share in (("most", 0.995), ("least", 0.9), ("middle", 0.95))
        ]
    )
    (words,) = when(table)
    assert "The rails hold 400 kN, of which most leaves 2.0 kN and least leaves 40.0 kN un" in words
    (alone,) = when(table[:1])
    assert "The rails hold 400 kN, of which most leaves 2.0 kN unused." in alone
    # One that cleans its rail by slip pulls more than another leaves on its own.
    table.loc[0, "pull"] += 20 * 0.995
    (cleaned,) = when(table)
    assert "The rails hold 400 to 420 kN, of which most leaves 2.1 kN and least" in cleaned
