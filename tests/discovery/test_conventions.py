"""Limits that are said to be conventions have the probability that is said."""

import numpy as np
import pytest
from scipy import stats

from adhesion_jax.data import events
from adhesion_jax.discovery.search import rules
from adhesion_jax.inference import fit
from adhesion_jax.inference.sums import TUNING
from adhesion_jax.measured import comparison, following, log
from adhesion_jax.report import plan


@pytest.mark.parametrize(
    ("errors", "inside"),
    [
        (rules.SURE_ERRORS, 1 - 2 * 0.10),  # one-sided 90 %
        (rules.SURE_ERRORS_OF_COLUMN, 1 - 2 * 0.05),  # one-sided 95 %
        (rules.AHEAD_ERRORS, 0.9545),  # two-sided 95 %, as two errors are said to be
        (following.QUANTILE, 0.95),
        (plan._QUANTILE, 0.95),
    ],
)
def test_an_error_bar_holds_its_share_of_a_normal_distribution(errors, inside):
    assert stats.norm.cdf(errors) - stats.norm.cdf(-errors) == pytest.approx(inside, abs=2e-3)


def test_a_gain_that_is_enough_is_half_a_chi_square_of_one_degree_of_freedom():
    assert stats.chi2.sf(2 * rules.LEAST_GAIN, 1) == pytest.approx(6e-5, rel=0.1)


@pytest.mark.parametrize(("p", "claimed"), [(0.0098, True), (0.0102, False)])
def test_a_change_between_groups_is_claimed_at_one_per_cent(p, claimed):
    fields = dict.fromkeys(comparison.Comparison._fields)
    assert comparison.Comparison(**{**fields, "p": p, "p_shape": 1.0}).changed == claimed
    assert comparison.Comparison(**{**fields, "p": 1.0, "p_shape": p}).bent == claimed


def test_limits_of_chance_are_those_that_are_said():
    # The coherence of noise is exponential.
    assert np.exp(-rules.HALF_FREQUENCY_COHERENCE) == pytest.approx(4.5e-5, rel=0.05)
    assert 2 * stats.norm.sf(rules.OUTLIER_DEVIATIONS) == pytest.approx(6e-7, rel=0.1)


@pytest.mark.parametrize("factor", [fit._NORMAL, events._NORMAL, log._NORMAL])
def test_a_median_deviation_is_that_of_a_normal_distribution(factor):
    assert factor * stats.norm.ppf(0.75) == pytest.approx(1, rel=1e-4)


def test_hubers_constant_loses_one_per_cent_of_efficiency():
    """Of normal noise: (E psi')^2/E psi^2 (Huber 1964, Ann. Math. Statist. 35:73-101)."""
    inside = 1 - 2 * stats.norm.sf(TUNING)
    beyond = 2 * TUNING**2 * stats.norm.sf(TUNING)
    square = inside - 2 * TUNING * stats.norm.pdf(TUNING) + beyond
    assert inside**2 / square == pytest.approx(0.99, abs=1e-3)
