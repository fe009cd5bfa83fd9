import json

import numpy as np
import pandas as pd
import pytest
from matplotlib.image import imread

from adhesion_jax.discovery.types import Errors, Findings, FoundEffect, Interval
from adhesion_jax.errors import InputError
from experiments.campaigns.simulator import SetNoise, simulate
from experiments.discovery_peers.__main__ import compared
from experiments.discovery_peers.features import fit_base, folds, in_runs, make_problem
from experiments.discovery_peers.report import beaten, draw_peers, peers_text, summarised
from experiments.discovery_peers.sets import (
    PeerSet,
    random_sets,
    right_columns,
    simulated_sets,
    stored_sets,
)
from experiments.discovery_study.judging import Hidden, counted
from experiments.discovery_study.one_log import one_log

SMALL = {"runs": 30, "points": 60}


@pytest.fixture(scope="module")
def campaign():
    return simulate(["humidity"], seed=1, strength=0.4, noise=SetNoise(sigma=0.005), **SMALL)


@pytest.mark.slow
def test_the_base_of_a_null_set_leaves_only_its_noise():
    for seed in (0, 2):
        null = simulate(seed=seed, noise=SetNoise(0.01, 0.0, 0.0), **SMALL)
        base = fit_base(null.train, null.test)
        left = np.sqrt(np.mean((null.clean - base.test) ** 2))
        assert left < 0.2 * 0.01


@pytest.mark.long
def test_features_stay_inside_their_run_and_folds_are_whole_runs(campaign):
    base = fit_base(campaign.train, campaign.test)
    problem = make_problem(campaign.train, campaign.test, base, dynamic=True)
    assert problem.train.shape == (len(campaign.train), len(problem.columns))
    assert np.isfinite(problem.train).all()
    assert np.isfinite(problem.test).all()
    # Runs in another order have the same features, so nothing leaks from run to run.
    runs = campaign.train["run"].unique()
    order = np.concatenate([np.flatnonzero(campaign.train["run"] == run) for run in runs[::-1]])
    turned = campaign.train.iloc[order].reset_index(drop=True)
    again = make_problem(turned, campaign.test, base._replace(train=base.train[order]), True)
    np.testing.assert_allclose(again.train, problem.train[order], atol=1e-9)
    parts = folds(problem.runs)
    assert sorted(np.concatenate(parts)) == list(range(len(problem.runs)))
    of_part = [set(problem.runs[part]) for part in parts]
    assert sum(map(len, of_part)) == len(runs)


@pytest.mark.thorough
def test_peers_find_a_strong_effect(campaign):
    pytest.importorskip("sklearn")
    pytest.importorskip("pysindy")
    from experiments.discovery_peers.methods import predicted

    base = fit_base(campaign.train, campaign.test)
    measured = campaign.test["adhesion"].to_numpy()
    before = np.mean((measured - base.test) ** 2)
    removable = before - campaign.test_rms_noise**2
    # A smooth function of one column: a polynomial has all of it; trees, which are steps and see
    # 21 runs, most.
    for name, least in (("sparse-regression", 0.98), ("trees", 0.7)):
        answer = predicted(name, campaign.train, campaign.test, base)
        after = np.mean((measured - answer.adhesion) ** 2)
        assert least < (before - after) / removable < 1.02
        assert answer.named == ("relative_humidity_pct",)


@pytest.mark.long
def test_simulated_sets_are_the_same_each_time_and_a_third_are_null():
    first, again = (list(simulated_sets(3, 4)) for _ in range(2))
    for one, other in zip(first, again, strict=True):
        pd.testing.assert_frame_equal(one.train, other.train)
    assert [one.planted for one in first] == ["humidity", "nothing", "patch"]


def stored(tmp_path, campaign, **answer):
    for name in ("train", "test"):
        getattr(campaign, name).to_csv(tmp_path / f"one_{name}.csv.gz", index=False)
    (tmp_path / "answers.json").write_text(json.dumps({"one": answer}))
    return stored_sets(tmp_path)


def test_stored_sets_are_read_or_refused(tmp_path, campaign):
    with pytest.raises(InputError, match=r"answers\.json"):
        stored_sets(tmp_path)
    (one,) = stored(
        tmp_path,
        campaign,
        effects=["age"],
        accepted=[["covariate:rail_age_days", "product:slip_ratio*temperature_C", "curve"]],
        test_rms_noise=0.005,
    )
    assert one.planted == "age"
    assert one.scored
    assert len(one.test) == len(campaign.test)
    (hidden,) = one.hidden
    assert hidden.columns == (
        *("rail_age_days", "slip_ratio", "temperature_C", "curvature_per_m", "position_m"),
    )
    with pytest.raises(InputError, match="test_rms_noise"):
        stored(tmp_path, campaign, effects=[])


def claim(*names: str, covariates: tuple[str, ...] = ()) -> FoundEffect:
    return FoundEffect(names[0], names, covariates, "", {}, {}, 0.001, np.nan, "")


def test_what_is_hidden_is_named_by_a_claim_of_its_class_or_by_a_column():
    def is_named(hidden, claim):
        return hidden.is_named_by(claim, counted(claim))

    lag = Hidden(("lag", "delay"), right_columns(["lag", "delay"]))
    assert "slip_size_change_over_5".startswith(lag.columns)
    assert not "temperature_C".startswith(lag.columns)
    assert is_named(lag, claim("hysteresis", "delay"))
    assert not is_named(lag, claim("hysteresis", "a", "b", "c", "delay"))
    assert is_named(Hidden(("product:",), ()), claim("product:a*b"))
    column = Hidden((), ("temperature_C",))
    assert is_named(column, claim("temperature"))
    assert is_named(column, claim("product:position_m*temperature_C"))
    assert is_named(column, claim("oddity", covariates=("temperature_C",)))
    assert not is_named(column, claim("humidity"))


@pytest.mark.slow
def test_a_log_without_runs_is_cut_into_blocks_and_compared(campaign):
    pytest.importorskip("sklearn")
    pytest.importorskip("threadpoolctl")
    log = one_log(["sanding"], seed=1, wheel_speed_noise=0.01)
    blocks = in_runs(log.train)["run"]
    assert (blocks.value_counts() == 250).all()
    assert blocks.is_monotonic_increasing
    assert in_runs(campaign.train) is campaign.train
    hidden = (Hidden(("slip_noise",), ()), Hidden(("sanding",), ("sanding", "sand_before")))
    part = PeerSet("log", "sanding", hidden, log.train, log.test, log.test_rms_noise, scored=False)
    seen: list[pd.DataFrame] = []

    def discover(train, *_):
        seen.append(train)
        nothing = Interval(0.02, 0.02, 0.02)
        fields = dict.fromkeys(Findings._fields)
        effects = (claim("slip_noise"), claim("patch"))
        told = {"effects": effects, "unexplained": (), "test": Errors(*[nothing] * 3, 1)}
        return Findings(**{**fields, **told})

    ours, trees = compared(part, ("discovery", "trees-dynamic"), discover, 0)
    assert "run" not in seen[0]
    assert (ours["hidden"], ours["named"], ours["false_names"]) == (2, 1, 1)
    assert np.isnan(ours["removed"])
    assert np.isfinite(trees["after"])
    assert "run" not in trees["names"].split("|")


@pytest.mark.slow
def test_random_sets_have_their_columns_for_answers():
    first = list(random_sets(4, 1))
    (again,) = random_sets(1, 1)
    pd.testing.assert_frame_equal(first[0].train, again.train)
    for one in first:
        assert all(column in one.train for hidden in one.hidden for column in hidden.columns)
    assert [len(one.hidden) for one in first] == [1, 1, 1, 2]
    assert first[0].planted.startswith("level by ")


def test_a_summary_counts_and_is_drawn(tmp_path):
    rows = pd.DataFrame(
        {
            "set": ["a", "b", "c"] * 2,
            "planted": ["patch", "nothing", "lag"] * 2,
            "method": ["discovery"] * 3 + ["other"] * 3,
            "removed": [0.95, np.nan, 0.5, 0.2, np.nan, 0.56],
            "worse": [False, False, False, True, True, False],
            "hidden": [1, 0, 2] * 2,
            "named": [1, 0, 1, 0, 0, 2],
            "right_names": [1, 0, 1, 0, 0, 1],
            "false_names": [0, 1, 1, 0, 0, 0],
            "seconds": [1.0, 2.0, 3.0, 1.0, 1.0, 1.0],
        }
    )
    table = summarised(rows).set_index("method")
    told = ["sets", "hidden", "hidden_named", "removed_90", "removed_of", "nulls_with_name"]
    assert table.loc["discovery", told].tolist() == [2, 3, 2, 1, 2, 1]
    assert table.loc["discovery", "removed_median"] == pytest.approx(0.725)
    assert table.loc["discovery", "removed_lowest_decile"] == pytest.approx(0.545)
    assert table.loc["other", ["worse", "nulls_worse", "hidden_named"]].tolist() == [1, 1, 2]
    lost = beaten(rows)
    assert lost[["set", "by"]].to_numpy().tolist() == [["c", "other"]]
    assert lost[["discovery", "removed"]].to_numpy().tolist() == [[0.5, 0.56]]
    said = peers_text(rows)
    assert "2 of 3" in said
    assert "more by 0.05" in said
    none_better = rows.assign(removed=rows["removed"].clip(upper=0.5))
    assert "more by" not in peers_text(none_better)
    draw_peers(tmp_path / "peers.png", rows)
    assert imread(tmp_path / "peers.png").shape[1] == 1500  # what it shows: test_figures.py
