"""The cases of a system: each once without noise, and many runs with noise."""

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest

from adhesion_jax.campaign import store
from adhesion_jax.campaign.keys import noise_keys
from adhesion_jax.campaign.traction import _status, content, job_of, judge, judged
from adhesion_jax.errors import InputError
from adhesion_jax.library.status import status
from adhesion_jax.metrics.closed_loop import FIGURES, by_segment, figures, whole
from adhesion_jax.metrics.moments import KnownMoments
from adhesion_jax.report.traction.page import traction_page
from adhesion_jax.traction.loop import run
from adhesion_jax.traction.plants.reading import read_plant, shipped
from adhesion_jax.traction.systems import SYSTEMS
from adhesion_jax.traction.systems.base import with_parts
from experiments.claims.traction import plant_of


def job(runs, duration=0.3, seed=0):
    system = SYSTEMS["hxd1f"]._replace(duration=duration)
    cases = with_parts(system.cases(system.step), "full-dimension", "constant-slip", "barrier")
    return job_of("hxd1f", system, cases, plant_of(system), runs, seed)


def judged_in_memory(runs, workers=1, seed=0):
    return judge(job(runs, seed=seed), workers)


@pytest.fixture(scope="module")
def few():
    return judged_in_memory(40)


@pytest.mark.slow
def test_runs_have_their_numbers_from_seed_and_run_alone(few):
    # 3 runs are in a tile of 32, 40 in one of 64: the first three are the same to the bit.
    three, again = judged_in_memory(3), judged_in_memory(3)
    pd.testing.assert_frame_equal(three.metrics, again.metrics, check_exact=True)
    other = judged_in_memory(3, seed=1)
    noisy = three.metrics["noise"] == "yes"
    assert (three.metrics["utilisation"] != other.metrics["utilisation"])[noisy].any()
    quiet = few.metrics["noise"] == "none"
    pd.testing.assert_frame_equal(
        few.metrics[quiet], three.metrics[~noisy], check_exact=True, check_like=True
    )


@pytest.mark.thorough
def test_processes_give_the_numbers_of_one(few):
    pd.testing.assert_frame_equal(
        few.metrics, judged_in_memory(40, workers=2).metrics, check_exact=True
    )


@pytest.mark.thorough
def test_runs_of_any_number_have_the_same_mean_and_deviation(few):
    twenty = judged_in_memory(20).metrics
    noisy = (twenty["noise"] == "yes") & (twenty["segment"] == "dry")
    one, many = twenty[noisy].iloc[0], few.metrics[noisy].iloc[0]
    for name in ("utilisation", "tracking_rms", "adhesion_rms"):
        # sd/sqrt(n - 1), of twenty runs and of forty.
        deviations = np.sqrt([19, 39]) * [one[f"{name}_se"], many[f"{name}_se"]]
        assert 0.5 < deviations[0] / deviations[1] < 2
        assert abs(one[name] - many[name]) < 5 * np.hypot(one[f"{name}_se"], many[f"{name}_se"])


@pytest.mark.thorough
def test_means_and_errors_are_those_of_the_runs_made_one_by_one(few):
    runs = 40
    asked = job(runs)
    ((_, (loop,), grid),) = asked.noisy
    one = jax.jit(lambda key: run(loop, grid, key))
    found = []
    for key in noise_keys(0, asked.cases[0].scenario, jnp.arange(runs)):
        totals = one(key)
        dry = jax.tree.map(lambda values: values[:1], by_segment(totals))
        parts = [figures(part, grid.sample_period) for part in (dry, whole(totals))]
        found.append([[float(part[name][0]) for part in parts] for name in FIGURES])
    rows = few.metrics[few.metrics["noise"] == "yes"]
    assert rows["segment"].tolist() == ["dry", "wet", "snow", "all"]
    for name, values in zip(FIGURES, np.array(found).transpose(1, 2, 0), strict=True):
        for row, each in zip((0, 3), values, strict=True):
            known = each[np.isfinite(each)]
            mean = known.mean() if len(known) else np.nan
            error = known.std(ddof=1) / np.sqrt(len(known)) if len(known) > 1 else np.nan
            assert rows[name].iloc[row] == pytest.approx(mean, rel=1e-6, nan_ok=True), name
            # The error is a difference of sums of squares, of which a few digits cancel.
            expected = pytest.approx(error, rel=1e-4, abs=1e-7 * abs(mean), nan_ok=True)
            assert rows[f"{name}_se"].iloc[row] == expected, name
    # The other rails begin at 5 and at 10 s.
    assert rows["status"].tolist() == ["regular", "not reached", "not reached", "regular"]


def contents(folder, asked):
    """What is stored of all shards, the times apart, and the rows."""
    found = []
    for number in range(asked.shards):
        arrays = store.read(folder, asked.name, number)
        found.append({key: x for key, x in arrays.items() if "seconds" not in key})
        found.append(store.rows_of(folder, asked.name, number).to_pandas())
    return found


def assert_same(one, other):
    assert len(one) == len(other)
    for a, b in zip(one, other, strict=True):
        assert [*a] == [*b]
        for key in a:
            np.testing.assert_array_equal(np.asarray(a[key]), np.asarray(b[key]), err_msg=key)


def complete(directory, asked, resume=False, extend=0):
    """Complete a folder; the numbers of the shards that were computed."""
    with store.opened(directory, "traction", [asked], resume, extend) as folder:
        work = store.missing(folder, [asked])
        for unit in reversed(work):
            store.stored(content, *unit, folder)
        return [number for _, number in work], contents(folder, asked)


@pytest.mark.thorough
def test_shards_are_resumed_and_extended_bit_for_bit(tmp_path, few):
    for name in ("whole", "resumed"):
        (tmp_path / name).mkdir()
    computed, whole = complete(tmp_path / "whole", job(300))
    assert computed == [0, 1, 2]
    # Forty runs, of which a file is damaged, and then 260 more.
    folder = tmp_path / "resumed" / store.FOLDER
    assert complete(tmp_path / "resumed", job(40))[0] == [0, 1]
    stored = [store.read(folder, "hxd1f", number) for number in range(2)]
    pd.testing.assert_frame_equal(judged(job(40), stored).metrics, few.metrics, check_exact=True)
    (folder / "hxd1f-00000.npz").write_bytes(b"damaged")
    told = status(tmp_path / "resumed")
    assert "hxd1f: 40 of 41 runs are finished" in told
    assert "barrier" in told
    computed, extended = complete(tmp_path / "resumed", job(300), resume=True, extend=260)
    assert computed == [0, 1, 2]  # the second had forty runs of 256
    assert_same(extended, whole)
    with pytest.raises(InputError, match="--seed is 0 there and 1 here"):
        complete(tmp_path / "resumed", job(300, seed=1), resume=True)
    with pytest.raises(InputError, match="settings of the system is another one"):
        complete(tmp_path / "resumed", job(300, duration=0.2), resume=True)
    with (
        pytest.raises(InputError, match="the command is traction there and montecarlo here"),
        store.opened(tmp_path / "resumed", "montecarlo", [job(300)], resume=True),
    ):
        pass


def test_shards_have_every_run_of_every_case_once():
    system = SYSTEMS["hxd1f"]
    asked = job_of("hxd1f", system, system.cases(system.step), plant_of(system), 600)
    first = len(asked.quiet)
    assert sum(map(asked.runs_of, range(first))) == len(asked.cases)
    runs = {}
    for number in range(first, asked.shards):
        (case,) = asked.in_shard(number).cases
        numbers = asked.noisy_runs(number)
        assert 0 < asked.runs_of(number) <= len(numbers)
        runs.setdefault(case, []).extend(numbers[: asked.runs_of(number)])
    assert runs == {case: [*range(600)] for case in range(len(asked.cases))}
    # A job of more runs has the same shards, and more.
    more = asked._replace(runs=6000)
    every = range(first, first + 2 * len(asked.cases))
    assert [more.noisy_runs(n) for n in every] == [asked.noisy_runs(n) for n in every]


@pytest.mark.parametrize(
    ("shares", "stood", "words"),
    [
        ([0.9, 0.8, 0.7], [0, 0, 0], "regular"),
        ([np.nan], [np.nan], "not reached"),
        ([np.nan], [0], "the computation fails"),
        ([0.9, np.nan, np.inf], [0, 0, 0], "the computation fails in 2 of 3 runs"),
        (
            [0.0, np.nan, np.nan],
            [1, 0, np.nan],
            "the computation fails in 1 of 3 runs, the train never moves in 1 of 3 runs",
        ),
    ],
)
def test_a_run_without_finite_numbers_failed(shares, stood, words):
    none = {name: np.zeros((len(shares), 1)) for name in FIGURES}
    known = {"utilisation": np.array(shares)[:, None], "stood": np.array(stood)[:, None]}
    assert _status(KnownMoments.of({**none, **known}), 0) == words


def test_the_verdict_names_methods_that_failed_and_takes_no_share_of_theirs():
    rows = [
        {"scenario": "rail", "method": method, "noise": noise, "utilisation": share, "status": told}
        for method, noise, share, told in (
            ("sound", "none", 0.9, "regular"),
            ("sound", "yes", 0.9, "the computation fails in 2 of 32 runs"),
            ("broken", "none", np.nan, "the computation fails"),
        )
    ]
    metrics = pd.DataFrame(rows).assign(
        segment="all", **dict.fromkeys({*FIGURES} - {"utilisation"}, 0.0)
    )
    metrics = metrics.assign(**{f"{name}_se": np.nan for name in FIGURES})
    system = SYSTEMS["hxd1f"]
    plant = read_plant(shipped()["hxd1f"])
    page = traction_page(system, plant, metrics, metrics, {}, 32)
    assert page.verdict == (
        "Share of the largest adhesion that is used, without noise: 90.0 % (“sound”). On “rail” "
        "with “sound” and noise the computation fails in 2 of 32 runs. On “rail” with “broken” "
        "the computation fails."
    )


@pytest.mark.slow
def test_a_train_stands_coasts_or_runs_away_under_eq_8():
    stands, coasts, runs_away = (
        "Eq. 8 from rest, K1 19000, K2 18000",
        "Eq. 8, K1 1000, K2 18000",
        "Eq. 8, K1 19000, 1.05 of critical K2",
    )
    system = SYSTEMS["fang2018"]._replace(duration=120.0, step=1e-3)
    cases = [
        case for case in system.cases(system.step) if case.method in (stands, coasts, runs_away)
    ]
    found = judge(job_of("fang2018", system, cases, plant_of(system)), 1)
    status = found.metrics.set_index(["method", "segment"])["status"]
    assert status[stands, "1"] == status[stands, "all"] == "the train never moves"
    assert status[coasts, "1"] == status[coasts, "all"] == "regular"
    assert status[coasts, "2"] == status[stands, "2"] == "not reached"
    assert status[runs_away, "2"] == status[runs_away, "all"] == "slip runs away"
    assert status[runs_away, "3"] == "not reached"
    # The controller takes over at 30 km/h: the torque of 1590 N m dies away, but for a moment
    # whenever the train is slower again and the driver's demand stands.
    coasting = found.traces[1].sample
    assert 30 < 3.6 * coasting.train_speed.max() < 31
    assert np.abs(coasting.torque[-1500:, 0]).mean() < 0.05 * 1590
    # 5 times the best slip of road 2, 5.5 km/h.
    assert 3.6 * found.traces[2].sample.slip[-1, 0] > 27.5
