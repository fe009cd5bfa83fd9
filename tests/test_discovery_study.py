import numpy as np
import pandas as pd
import pytest
from scipy.stats import binomtest

from adhesion_jax.discovery.findings import Errors, Findings, FoundEffect, Interval
from adhesion_jax.discovery.simulated_runs import FAMILIES
from adhesion_jax.discovery.simulator import Noise
from adhesion_jax.discovery.study import (
    Task,
    clopper_pearson,
    confusion,
    is_right,
    make_set,
    rates,
    removed_share,
    run_study,
    study_tasks,
)
from adhesion_jax.errors import InputError
from experiments.discovery_study import OWN_FILES, study

NOISE = Noise(0.01, 0.0, 0.0)


def answer(*classes: tuple[str, ...], before: float = 0.02, after: float = 0.01) -> Findings:
    """Findings that report these classes; what the study does not read is left out."""
    found = tuple(
        FoundEffect(names[0], names, (), "", {}, {}, 0.001, np.nan, "") for names in classes
    )
    nowhere = Interval(np.nan, np.nan, np.nan)
    test = Errors(nowhere._replace(value=before), nowhere._replace(value=after), nowhere, 12)
    fields = dict.fromkeys(Findings._fields)
    told = {"base": "kiencke", "effects": found, "unexplained": (), "test": test}
    return Findings(**{**fields, **told})


def task(part: str, effects: tuple[str, ...], seed: int, visible: float | None = None) -> Task:
    return Task(part, effects, seed, FAMILIES[seed % 4], False, "perturbed", NOISE, visible)


@pytest.mark.parametrize(("hits", "count"), [(0, 20), (3, 20), (20, 20), (1, 200), (7, 9)])
def test_intervals_are_the_exact_ones(hits, count):
    rate = clopper_pearson(hits, count)
    exact = binomtest(hits, count).proportion_ci(method="exact")
    np.testing.assert_allclose(rate, (hits / count, exact.low, exact.high), atol=1e-12)


def test_no_sets_have_no_rate():
    assert np.isnan(clopper_pearson(0, 0)).all()


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
    done: list[str] = []
    sets = run_study(tasks, lambda *_: next(answers), done.append)
    assert done == [one.part for one in tasks]
    assert sets["in_class"].tolist() == [False] * 4 + [True, True, False, True, False]
    assert sets["first_right"].tolist() == [False] * 4 + [True, False, False, True, False]
    assert sets["extra"].tolist() == [
        *[False, True, False, False],
        *[False, True, False, False, True],
    ]
    assert sets["worse"].tolist() == [False] * 8 + [True]

    table = rates(sets).set_index(["part", "group", "quantity"])
    assert table.loc[("nothing", "all", "claimed"), ["hits", "count"]].tolist() == [1, 4]
    exact = binomtest(1, 4).proportion_ci(method="exact")
    row = table.loc[("nothing", "all", "claimed")]
    assert (row["low"], row["high"]) == pytest.approx((exact.low, exact.high))
    assert table.loc[("confusion", "temperature", "detected"), "rate"] == pytest.approx(2 / 3)
    assert table.loc[("confusion", "patch", "in_class"), "hits"] == 1
    by_base = table.loc["nothing"].filter(like="base ", axis=0)
    assert by_base["hits"].sum() == 1

    counts = confusion(sets)
    assert counts.loc["temperature", ["temperature", "drift", "nothing"]].tolist() == [1, 1, 1]
    assert counts.loc["patch", ["covariate:position_m", "humidity", "patch"]].tolist() == [1, 1, 0]
    assert counts.to_numpy().sum() == 5


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
    assert is_right("torque_offset", "slip_bias")
    assert is_right("product", "product:gradient_permille,temperature_C")
    assert not is_right("temperature", "humidity")


def test_the_removed_share_needs_something_to_remove():
    assert removed_share(0.02, 0.01, 0.01) == pytest.approx(1.0)
    assert removed_share(0.02, 0.02, 0.01) == 0.0
    assert np.isnan(removed_share(0.01, 0.01, 0.01))


def test_a_study_writes_its_files(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("adhesion_jax.discovery.study.FOLLOWED", ("humidity",))
    monkeypatch.setattr("adhesion_jax.discovery.study.VISIBLE", (0.5, 2.0))
    monkeypatch.setattr("adhesion_jax.discovery.study.EFFECTS", {"humidity": None, "speed": None})
    monkeypatch.setattr("adhesion_jax.discovery.study.BEYOND", ())
    shares = study(4, 1, 0, tmp_path, lambda *_: answer(("humidity", "drift")))
    assert {file.name for file in tmp_path.iterdir()} == {*OWN_FILES}
    sets = pd.read_csv(tmp_path / "sets.csv")
    assert sets["part"].value_counts().to_dict() == {"nothing": 4, "power": 2, "confusion": 2}
    assert (
        shares.loc[(shares["part"] == "nothing") & (shares["group"] == "all"), "hits"].item() == 4
    )
    assert "False claims on null sets: 4 of 4" in capsys.readouterr().out
    with pytest.raises(InputError, match="above 0"):
        study(0, 0, 0, tmp_path, lambda *_: answer())
