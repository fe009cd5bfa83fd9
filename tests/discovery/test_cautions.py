"""What is said of test data that the training data hardly cover."""

import numpy as np
import pytest
from discovery_campaigns import campaign, curve, noise, problem_of, runs_of

from adhesion_jax.curves import CURVES
from adhesion_jax.data import matching
from adhesion_jax.discovery.findings.cautions import extrapolated
from adhesion_jax.discovery.findings.summary import ranges_of
from adhesion_jax.discovery.search.state import Accepted
from adhesion_jax.effects.law import CorrectedLaw


@pytest.fixture(scope="module")
def training():
    """Adhesion that falls with `warm`, which is low in nine runs of ten and high in the others."""
    draw = np.random.default_rng(4)
    table = campaign(draw)
    warm = np.where(table["run"] == 0, 1.0, 0.2 * table["warm"] / table["warm"].abs().max())
    adhesion = curve(table["slip_ratio"]) * np.exp(-0.1 * warm) + noise(draw)
    return table.assign(warm=warm, adhesion=adhesion)


@pytest.fixture(scope="module")
def said(training):
    name, columns = "covariate:warm", ("warm",)
    effect = Accepted(name, (name,), "warm", True, columns, (), p=0.001, gain=50.0)
    problem, runs = problem_of(training), runs_of(training)
    law = CorrectedLaw(CURVES["burckhardt"], (), ranges_of(problem, runs), problem.calendar)

    def of(table):
        return extrapolated([effect], problem, law, runs, matching(runs, runs_of(table)))

    return of


def test_test_data_like_the_training_data_are_passed_over(training, said):
    assert said(training.assign(adhesion=training["adhesion"] + 0.001)) == []
    # A few test points at the edge of what was measured are no reason.
    some = training["run"] < 3
    assert said(training.assign(warm=training["warm"].where(~some, 0.9))) == []


def test_a_column_of_the_law_whose_middles_do_not_touch_is_told(training, said):
    ((share, words),) = said(training.assign(warm=0.8 + 0.1 * (training["run"] % 2)))
    assert share == 1.0
    assert words.startswith("Nine in ten test points have warm from 0.8 to 0.9, nine in ten ")
    # Another column may be anywhere: the law does not rest on it.
    assert said(training.assign(old=training["old"] + 100)) == []


def test_a_slip_that_was_hardly_measured_is_told(training, said):
    """Test runs of rolling alone have no larger slip than those of training."""
    low = 0.005 * training["slip_ratio"]
    found = said(training.assign(slip_ratio=low, adhesion=curve(low)))
    assert [words[:35] for _, words in found] == ["Nine in ten test points have a slip"]
    # Beyond the largest of training one sentence says so, of a column as well.
    (column, slip) = (
        said(training.assign(warm=training["warm"] + 3)),
        said(training.assign(slip_ratio=training["slip_ratio"] + 0.3)),
    )
    assert [words[:5] for _, words in (*column, *slip)] == ["100 %", "100 %"]
