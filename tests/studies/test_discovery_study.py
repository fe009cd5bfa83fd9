import hashlib
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.stats import beta

from adhesion_jax.discovery.types import Doubt, Errors, Findings, FoundEffect, Interval
from adhesion_jax.effects import family_of
from adhesion_jax.errors import InputError
from adhesion_jax.library.status import status
from experiments import campaigns
from experiments.campaigns.plantable import PLANTABLE
from experiments.campaigns.runs import BASE_CURVES
from experiments.campaigns.simulator import SetNoise
from experiments.discovery_study.__main__ import OWN_FILES, study
from experiments.discovery_study.judging import is_one_of, names_for, row
from experiments.discovery_study.random_effect import RandomEffect
from experiments.discovery_study.rates import confusion, rates, shares
from experiments.discovery_study.tasks import Task, make_set, study_tasks
from experiments.study import removed_share

NOISE = SetNoise(0.01, 0.0, 0.0)


def rows(tasks, discover):
    return pd.DataFrame([row(discover, task) for task in tasks])


def nothing_found(*_) -> Findings:
    return answer()


def answer(*classes: tuple[str, ...], before: float = 0.02, after: float = 0.01) -> Findings:
    """Findings that report these classes; what the study does not read is left out."""
    found = tuple(
        FoundEffect(names[0], names, (), "", {}, {}, 0.001, np.nan, "") for names in classes
    )
    nowhere = Interval(np.nan, np.nan, np.nan)
    test = Errors(nowhere._replace(value=before), nowhere._replace(value=after), nowhere, 12)
    fields = dict.fromkeys(Findings._fields)
    told = {"base": "kiencke", "effects": found, "unexplained": (), "test": test, "doubts": ()}
    return Findings(**{**fields, **told})


def task(part: str, effects: tuple[str, ...], seed: int, visible: float | None = None) -> Task:
    return Task(part, effects, seed, BASE_CURVES[seed % 4], False, "perturbed", NOISE, visible)


@pytest.mark.long
def test_rates_and_confusions_are_counted():
    tasks = [
        *(task("nothing", (), seed) for seed in range(4)),
        *(task("confusion", ("temperature",), seed) for seed in range(4, 7)),
        *(task("confusion", ("patch",), seed) for seed in range(7, 9)),
    ]
    answers = iter(
        [
            *(answer(), answer(("lag",)), answer(), answer()),
            answer(("temperature", "drift")),
            answer(("drift", "temperature"), ("lag",)),
            answer(),
            answer(("covariate:position_m",)),
            answer(("humidity",), before=0.01, after=0.02),
        ]
    )
    sets = rows(tasks, lambda *_: next(answers))
    assert sets["in_class"].tolist() == [False] * 4 + [True, True, False, True, False]
    assert sets["first_right"].tolist() == [False] * 4 + [True, False, False, True, False]
    assert sets["extra"].tolist() == [
        *[False, True, False, False],
        *[False, True, False, False, True],
    ]
    assert sets["worse"].tolist() == [False] * 8 + [True]

    table = rates(sets).set_index(["part", "group", "quantity"])
    assert table.loc[("nothing", "all", "claimed"), ["hits", "count"]].tolist() == [1, 4]
    row = table.loc[("nothing", "all", "claimed")]
    exact = beta.ppf(0.025, 1, 4), beta.ppf(0.975, 2, 3)
    assert (row["low"], row["high"]) == pytest.approx(exact)
    assert table.loc[("confusion", "temperature", "detected"), "rate"] == pytest.approx(2 / 3)
    assert table.loc[("confusion", "patch", "in_class"), "hits"] == 1
    by_base = table.loc["nothing"].filter(like="base ", axis=0)
    assert by_base["hits"].sum() == 1

    counts = confusion(sets)
    assert counts.loc["temperature", ["temperature", "drift", "nothing"]].tolist() == [1, 1, 1]
    assert counts.loc["patch", ["covariate:position_m", "humidity", "patch"]].tolist() == [1, 1, 0]
    assert counts.to_numpy().sum() == 5


def test_a_share_of_no_sets_is_no_number():
    seen = ("detected", "all_named", "in_class", "extra")
    one = {"part": "random", "acts_on": "level", "rests_on": "temperature_C", "removed": np.nan}
    one |= {"claims": 1, "visible": 1.0, "wanted": 1.0, "planted": "random", "form": "exact"}
    table = rates(pd.DataFrame([one | dict.fromkeys(seen, True)])).set_index(["group", "quantity"])
    shares_of = ["rate", "low", "high"]
    assert table.loc[("all", "removed_90"), shares_of].isna().all()
    assert table.loc[("all", "detected"), shares_of].tolist() == pytest.approx([1.0, 0.025, 1.0])


def test_a_wanted_visible_misfit_is_met():
    for wanted in (0.2, 1.0):
        assert make_set(task("power", ("humidity",), 3, wanted)).visible == pytest.approx(
            wanted, rel=0.05
        )


def test_tasks_are_balanced_and_no_two_share_a_seed():
    tasks = study_tasks(16, 2, 5)
    nulls = [one for one in tasks if one.part == "nothing"]
    pairs = pd.Series([(one.base, one.operational) for one in nulls]).value_counts()
    assert len(pairs) == 8
    assert (pairs == 2).all()
    assert len({one.seed for one in tasks}) == len(tasks)
    assert not any(one.operational for one in tasks if one.part != "nothing")
    assert study_tasks(16, 2, 5) == tasks


def test_other_words_for_the_same_cause_are_right():
    assert is_one_of("slip_bias", names_for("torque_offset"))
    assert is_one_of("product:gradient_permille,temperature_C", names_for("product"))
    assert not is_one_of("humidity", names_for("temperature"))


def test_the_removed_share_needs_something_to_remove():
    assert removed_share(0.02, 0.01, 0.01) == pytest.approx(1.0)
    assert removed_share(0.02, 0.02, 0.01) == 0.0
    assert np.isnan(removed_share(0.01, 0.01, 0.01))


def test_the_sets_of_the_first_parts_are_those_of_old():
    """Digests of the tasks as they were before there were other parts and slow nulls."""
    for sizes, digest in (
        ((16, 2, 5), "8c00562c7546a231a442f1b5f25de51b5ae693f9aabb704e08501632a86bc5a1"),
        ((200, 4, 0), "f77718842bee5bd36ad936de0d55c7bfa2dca12d6390180a8263a82f5cceed11"),
        ((7, 0, 1), "8ba1735d3f318100aa66c5af56a16633136b4bdf17b6088c638a268140d44536"),
    ):
        null = sizes[0]
        told = []
        for place, one in enumerate(study_tasks(*sizes)):
            slow = null - null // 2 <= place < null
            noise = one.noise._replace(autocorrelation=-1.0) if slow else one.noise
            told.append((*one[:6], noise, one.visible))
        written = repr(told).replace("SetNoise(", "Noise(")  # as the class was called then
        assert hashlib.sha256(written.encode()).hexdigest() == digest


def test_half_of_the_nulls_have_slow_noise():
    values = [one.noise.autocorrelation for one in study_tasks(21, 0, 3)]
    assert {*values[:11]} <= {0.0, 0.3, 0.6}
    assert len({*values[11:]}) == 10
    assert all(0.3 < value < 0.95 for value in values[11:])


def test_new_parts_draw_for_themselves_and_share_no_seed():
    more = {"pairs": 24, "random": 24, "logs": 1, "log_effects": 2}
    tasks = study_tasks(16, 1, 2, **more)
    assert tasks[: len(study_tasks(16, 1, 2))] == study_tasks(16, 1, 2)
    assert len({one.seed for one in tasks}) == len(tasks)
    alone = study_tasks(0, 0, 2, random=24)
    assert [one for one in tasks if one.part == "random"] == alone
    pairs = [one for one in tasks if one.part == "pair"]
    assert len(pairs) == 24
    assert all(len({family_of(name) for name in one.effects}) == 2 for one in pairs)
    kinds = pd.Series([(one.random.acts_on, len(one.random.columns)) for one in alone])
    assert (kinds.value_counts() == 4).all()
    assert kinds.nunique() == 6
    assert all(0.5 < one.visible < 3.0 for one in alone)
    assert len({(one.base, *kind) for one, kind in zip(alone, kinds, strict=True)}) == 24
    logs = [one for one in tasks if one.part == "log"]
    assert len(logs) == 8 + 6
    assert [one.effects for one in logs[8:]] == [
        (name,) for name in ("humidity", "sanding", "falling_friction") for _ in range(2)
    ]


@pytest.mark.slow
def test_a_random_effect_is_seen_enough():
    (level, slip, fall) = study_tasks(0, 0, 4, random=3)
    for one in (level, slip, fall):
        assert make_set(one).visible >= 0.5
    # In too much noise nothing of it would be seen: the noise gives way.
    loud = fall._replace(noise=SetNoise(1.0, 0.0, 0.0))
    heard = make_set(loud)
    assert heard.visible == pytest.approx(0.55)
    assert heard.noise.sigma < 1.0


def random_task(*columns: str) -> Task:
    effect = RandomEffect(columns, "level")
    return Task("random", (), 0, "burckhardt", False, "exact", NOISE, None, random=effect)


@pytest.mark.parametrize(
    ("classes", "named", "extra"),
    [
        ([("covariate:temperature_C",), ("lag", "patch")], True, False),
        ([("product:temperature_C*position_m",)], True, False),
        ([("temperature",)], False, False),
        ([("temperature",), ("rail_joint",), ("speed",)], True, True),
        ([("temperature",), ("lag", "a", "b", "c", "patch")], False, True),
        ([], False, False),
    ],
)
def test_a_random_effect_is_named_by_all_of_its_columns(classes, named, extra):
    task_ = random_task("temperature_C", "position_m")
    sets = rows([task_], lambda *_: answer(*classes))
    assert sets["all_named"].item() == named
    assert sets["extra"].item() == extra
    table = rates(sets).set_index(["group", "quantity"])
    assert table.loc[("two columns", "all_named"), "hits"] == named
    assert table.loc[("level", "all_named"), "count"] == 1
    assert ("one column", "all_named") in table.index
    assert table.loc[("one column", "all_named"), "count"] == 0


def test_what_an_effect_rests_on_names_its_columns():
    found = answer(("oddity",))
    claim = found.effects[0]._replace(covariates=("temperature_C",))
    findings = found._replace(effects=(claim,))
    sets = rows([random_task("temperature_C")], lambda *_: findings)
    assert sets["all_named"].item()


def test_both_of_a_pair_are_to_be_named():
    pair = task("pair", ("humidity", "patch"), 0)
    answers = iter([answer(("humidity",), ("patch",)), answer(("humidity",), ("humidity", "lag"))])
    sets = rows([pair, pair], lambda *_: next(answers))
    table = rates(sets).set_index("quantity")
    assert table.loc[["both_named", "one_named", "extra"], "hits"].tolist() == [1, 2, 0]


def test_a_class_of_more_than_four_counts_by_its_first():
    four, five = ("lag", "a", "b", "humidity"), ("lag", "a", "b", "c", "humidity")
    answers = iter([answer(four), answer(five)])
    one = task("confusion", ("humidity",), 0)
    sets = rows([one, one], lambda *_: next(answers))
    assert sets["in_class"].tolist() == [True, False]
    assert sets["extra"].tolist() == [False, True]


def test_a_doubt_that_names_the_column_of_a_random_effect_is_counted():
    doubting = answer()._replace(doubts=(Doubt(("position_m",), ""),))
    tasks = [random_task("position_m"), random_task("temperature_C")]
    sets = rows(tasks, lambda *_: doubting)
    assert sets["doubted"].tolist() == [True, False]
    assert not sets["in_class"].any()


def test_a_doubt_names_an_offset_and_nothing_else():
    doubting = answer()._replace(doubts=(Doubt(("torque_offset", "slip_bias"), ""),))
    tasks = [task("confusion", (name,), 1) for name in ("slip_bias", "torque_offset", "humidity")]
    tasks.append(task("nothing", (), 1))
    sets = rows(tasks, lambda *_: doubting)
    assert sets["in_class"].tolist() == [True, True, False, False]
    assert not sets["detected"].any()
    assert not sets["extra"].any()


def test_noise_of_the_slip_is_no_claim_on_a_log():
    null, _, noisy, *_ = study_tasks(0, 0, 0, logs=1)
    (wet, *_) = study_tasks(0, 0, 0, log_effects=1)
    assert wet.effects == ("humidity",)
    answers = iter(
        [
            *(answer(("slip_noise",)), answer(("slip_noise",), ("patch",))),
            *(answer(("slip_noise", "lag"), ("drift",)), answer(("slip_noise",)), answer()),
        ]
    )
    sets = rows([null, null, wet, wet, noisy], lambda *_: next(answers))
    assert sets["claims"].tolist() == [0, 1, 1, 0, 0]
    assert sets["reported"].tolist()[:2] == ["slip_noise", "slip_noise|patch"]
    assert sets["in_class"].tolist() == [False, False, True, False, False]
    # The noise of the slip is in every prediction: nobody removes it.
    assert sets["removed"].notna().tolist() == [True] * 4 + [False]
    table = rates(sets).set_index(["group", "quantity"])
    null_kind = ("nothing: 1 x 3000, 0 m/s, r = 0", "claimed")
    assert table.loc[null_kind, ["hits", "count"]].tolist() == [1, 2]
    assert table.loc[("humidity", "named"), ["hits", "count"]].tolist() == [1, 2]
    assert table.loc[("humidity", "extra"), "hits"] == 0


def test_the_quantiles_of_the_shares_are_those_of_numpy():
    removed = np.linspace(-0.2, 1.0, 12)
    sets = pd.DataFrame(
        {
            "part": "random",
            "removed": removed,
            "acts_on": ["level", "slip", "fall"] * 4,
            "rests_on": ["temperature_C"] * 6 + ["temperature_C*position_m"] * 6,
        }
    )
    table = shares(sets).set_index("group")
    for group, chosen in (("all", removed), ("slip", removed[1::3]), ("two columns", removed[6:])):
        expected = np.quantile(chosen, [0.5, 0.25, 0.1])
        np.testing.assert_allclose(
            table.loc[group, ["median", "lower_quartile", "lowest_decile"]].astype(float), expected
        )
    assert table.loc["one column", "sets"] == 6


@pytest.mark.slow
def test_workers_and_a_study_that_is_resumed_give_the_rows_of_one_process(tmp_path):
    sizes = {"null": 3, "powers": 0, "seed": 6, "random": 1, "log_effects": 1}

    def sets(out):
        return pd.read_csv(out / "sets.csv").drop(columns=["seconds", "cpu_seconds"])

    one, two = tmp_path / "one", tmp_path / "two"
    study(sizes, one, nothing_found)
    study(sizes, two, nothing_found, workers=2)
    pd.testing.assert_frame_equal(sets(one), sets(two), check_exact=True)
    tasks = study_tasks(**sizes)
    rows(tasks, nothing_found).to_csv(tmp_path / "sets.csv", index=False)
    pd.testing.assert_frame_equal(sets(one), sets(tmp_path), check_exact=True)
    before = pd.read_csv(two / "sets.csv")
    (two / "shards" / "study-00001.npz").write_bytes(b"damaged")
    (two / "shards" / "study-00003.parquet").unlink()
    said = status(two)
    assert f"{len(tasks) - 2} of {len(tasks)} runs are finished" in said
    study(sizes, two, nothing_found, resume=True)
    pd.testing.assert_frame_equal(sets(two), sets(one), check_exact=True)
    kept = [place for place in range(len(tasks)) if place not in (1, 3)]
    again = pd.read_csv(two / "sets.csv")
    assert again["seconds"][kept].tolist() == before["seconds"][kept].tolist()
    with pytest.raises(InputError, match="--null is 3 there and 4 here"):
        study({**sizes, "null": 4}, two, nothing_found, resume=True)


def test_a_study_is_not_resumed_with_another_simulator(tmp_path, monkeypatch):
    sizes = {"null": 1, "powers": 0, "seed": 6}
    study(sizes, tmp_path / "out", nothing_found)
    other = shutil.copytree(Path(campaigns.__file__).parent, tmp_path / "campaigns")
    monkeypatch.setattr(campaigns, "__file__", str(other / "__init__.py"))
    study(sizes, tmp_path / "out", nothing_found, resume=True)
    with (other / "simulator.py").open("a") as simulator:
        simulator.write("# changed")
    with pytest.raises(InputError, match="source of the study"):
        study(sizes, tmp_path / "out", nothing_found, resume=True)


@pytest.mark.thorough
def test_a_study_writes_its_files(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("experiments.discovery_study.tasks.FOLLOWED", ("humidity",))
    monkeypatch.setattr("experiments.discovery_study.tasks.VISIBLE", (0.5, 2.0))
    some = {name: PLANTABLE[name] for name in ("humidity", "speed")}
    monkeypatch.setattr("experiments.discovery_study.tasks.PLANTABLE", some)
    sizes = {"null": 4, "powers": 1, "seed": 0, "pairs": 1, "random": 6, "logs": 1}
    study(sizes, tmp_path, lambda *_: answer(("humidity", "drift")))
    table = pd.read_csv(tmp_path / "rates.csv")
    assert {file.name for file in tmp_path.iterdir()} == {*OWN_FILES, "shards"}
    sets = pd.read_csv(tmp_path / "sets.csv")
    assert sets["part"].value_counts().to_dict() == {
        "nothing": 4,
        "power": 2,
        "confusion": 2,
        "pair": 1,
        "random": 6,
        "log": 8,
    }
    assert (sets["cpu_seconds"] >= 0).all()
    hits = table.loc[(table["part"] == "nothing") & (table["group"] == "all"), "hits"]
    assert hits.item() == 4
    said = capsys.readouterr().out
    assert "False claims on null sets: 4 of 4" in said
    assert "False claims on those with slow noise: 2 of 2" in said
    assert said.index("Random effects") < said.index("False claims")
    with pytest.raises(InputError, match="above 0"):
        study({"null": 0, "powers": 0, "seed": 0}, tmp_path, lambda *_: answer())
