import json

import numpy as np
import pandas as pd
import pytest

from adhesion_jax.discovery.simulator import Noise, simulate
from adhesion_jax.errors import InputError
from adhesion_jax.report.discovery_peers import draw_peers, peers_text, summarised
from experiments.peer_features import fit_base, folds, make_problem
from experiments.peer_sets import is_right_column, simulated_sets, stored_sets

SMALL = {"runs": 30, "points": 60}


@pytest.fixture(scope="module")
def campaign():
    return simulate(["humidity"], seed=1, strength=0.4, noise=Noise(sigma=0.005), **SMALL)


def test_the_base_of_a_null_set_leaves_only_its_noise():
    for seed in (0, 2):
        null = simulate(seed=seed, noise=Noise(0.01, 0.0, 0.0), **SMALL)
        base = fit_base(null.train, null.test)
        left = np.sqrt(np.mean((null.clean - base.test) ** 2))
        assert left < 0.2 * 0.01


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


def test_peers_find_a_strong_effect(campaign):
    pytest.importorskip("sklearn")
    pytest.importorskip("pysindy")
    from experiments.peer_methods import predicted

    base = fit_base(campaign.train, campaign.test)
    measured = campaign.test["adhesion"].to_numpy()
    before = np.mean((measured - base.test) ** 2)
    for name in ("sparse-regression", "trees"):
        answer = predicted(name, campaign.train, campaign.test, base)
        assert np.mean((measured - answer.adhesion) ** 2) < 0.9 * before
        assert "relative_humidity_pct" in answer.named


def test_simulated_sets_are_the_same_each_time_and_a_third_are_null():
    first, again = (list(simulated_sets(3, 4)) for _ in range(2))
    for one, other in zip(first, again, strict=True):
        pd.testing.assert_frame_equal(one.train, other.train)
    assert [one.effects for one in first] == [("humidity",), (), ("patch",)]


def test_stored_sets_are_read_or_refused(tmp_path, campaign):
    with pytest.raises(InputError, match=r"answers\.json"):
        stored_sets(tmp_path)
    for name in ("train", "test"):
        getattr(campaign, name).to_csv(tmp_path / f"one_{name}.csv.gz", index=False)
    truth = {"one": {"effects": ["humidity"], "test_rms_noise": 0.005}}
    (tmp_path / "answers.json").write_text(json.dumps(truth))
    (one,) = stored_sets(tmp_path)
    assert one.effects == ("humidity",)
    assert len(one.test) == len(campaign.test)
    (tmp_path / "answers.json").write_text(json.dumps({"one": {"effects": []}}))
    with pytest.raises(InputError, match="test_rms_noise"):
        stored_sets(tmp_path)


def test_columns_of_an_effect_are_right_names():
    assert is_right_column(["humidity", "lag"], "slip_size_change_over_5")
    assert not is_right_column(["humidity"], "temperature_C")
    assert not is_right_column([], "temperature_C")


def test_a_summary_counts_and_is_drawn(tmp_path):
    rows = pd.DataFrame(
        {
            "set": ["a", "b", "c"] * 2,
            "planted": ["patch", "nothing", "lag"] * 2,
            "method": ["one"] * 3 + ["other"] * 3,
            "removed": [0.95, np.nan, 0.5, 0.2, np.nan, np.nan],
            "worse": [False, False, False, True, True, False],
            "right_names": [1, 0, 0, 0, 0, 1],
            "false_names": [0, 1, 1, 0, 0, 0],
            "seconds": [1.0, 2.0, 3.0, 1.0, 1.0, 1.0],
        }
    )
    table = summarised(rows).set_index("method")
    assert table.loc["one", ["sets", "removed_90", "removed_of", "nulls_with_name"]].tolist() == [
        *(2, 1, 2, 1)
    ]
    assert table.loc["one", "removed_median"] == pytest.approx(0.725)
    assert table.loc["other", ["worse", "nulls_worse", "sets_with_right_name"]].tolist() == [1] * 3
    assert "1 of 2" in peers_text(summarised(rows))
    draw_peers(tmp_path / "peers.png", rows)
    assert (tmp_path / "peers.png").stat().st_size > 0
