"""What is left of the levels of runs, held against columns that differ between them."""

import numpy as np
import pytest
from discovery_campaigns import SIZE, problem_of

from adhesion_jax.discovery.model.bases import first_fits, fits_alone
from adhesion_jax.discovery.model.fitting import Setting
from adhesion_jax.discovery.model.noise import white_noise
from adhesion_jax.discovery.search.judgement import level_doubts
from adhesion_jax.discovery.search.run_levels import followed
from adhesion_jax.discovery.search.state import settled
from adhesion_jax.simulation.simulator import simulate

RUNS = 28


def columns_of(draw):
    return {"age": draw.uniform(0, 200, RUNS), "load": draw.normal(9e4, 1e4, RUNS)}


def test_the_column_that_the_levels_follow_is_named_whatever_its_scale():
    draw = np.random.default_rng(1)
    columns = columns_of(draw)
    levels = np.exp(-columns["age"] / 60) + 0.1 * draw.standard_normal(RUNS)
    found = followed(levels, columns, seed=0)
    assert found.column == "age"
    assert found.p == 1 / 2000
    # Signal and noise have variances of .073 and .01.
    assert found.explained == pytest.approx(0.073 / 0.083, abs=0.08)
    bent = {"age": columns["age"] ** 3, "load": columns["load"]}
    assert followed(5 * levels - 3, bent, seed=0).explained == pytest.approx(found.explained)


def test_of_levels_without_a_cause_one_in_a_hundred_follows_a_column():
    found = []
    for seed in range(200):
        draw = np.random.default_rng([2, seed])
        found.append(followed(draw.standard_normal(RUNS), columns_of(draw), seed))
    below = np.mean([one.p <= 0.05 for one in found])
    # Three standard errors of a share of .05 among 200.
    assert below == pytest.approx(0.05, abs=3 * np.sqrt(0.05 * 0.95 / 200))
    assert np.mean([one.explained for one in found]) == pytest.approx(0.06, abs=0.06)


def test_few_runs_or_no_column_that_differs_say_nothing():
    draw = np.random.default_rng(3)
    assert followed(draw.standard_normal(8), {"age": np.arange(8.0)}, 0) is None
    assert followed(draw.standard_normal(20), {"age": np.repeat([1.0, 2.0], 10)}, 0) is None
    assert followed(np.zeros(20), {"age": np.arange(20.0)}, 0) is None


@pytest.fixture(scope="module")
def null():
    return simulate(seed=4, base="burckhardt", **SIZE).train


def state_of(table):
    problem = problem_of(table)
    setting = Setting(problem, white_noise(problem.points, 0.02), np.asarray(problem.data.adhesion))
    return settled(first_fits(fits_alone(setting, ["burckhardt"])), (), ())


@pytest.mark.thorough
def test_levels_that_follow_a_column_are_told_where_no_effect_is_accepted(null):
    age = null["rail_age_days"]
    worn = np.exp(-2 * (age - age.min()) / np.ptp(age))
    (doubt,) = level_doubts(state_of(null.assign(adhesion=null["adhesion"] * (1 + 0.3 * worn))), 0)
    assert doubt.names == ("rail_age_days",)
    assert "follows rail_age_days" in doubt.sentence


def test_levels_of_noise_raise_no_doubt(null):
    draw = np.random.default_rng(6)
    scatter = 1 + 0.05 * draw.standard_normal(null["run"].nunique())
    levels = scatter[null["run"].factorize()[0]]
    assert level_doubts(state_of(null.assign(adhesion=null["adhesion"] * levels)), 0) == ()
