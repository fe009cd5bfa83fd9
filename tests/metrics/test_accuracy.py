"""Which fits count as failed, and which efficiencies as comparable, at the limits that are told."""

import operator
from functools import partial, reduce

import jax
import numpy as np
import pytest

from adhesion_jax.metrics.accuracy import Outcome, Truth, run_statistics, table_rows
from adhesion_jax.metrics.moments import Moments

RUNS, SIGMA = 5000, 0.04


def row_of(gap=0.0, on_box=0.0, optimum_on_box=0.0):
    """The row of one quantity of 5000 runs, of which these shares lie on the box."""

    def of_the_first(share):
        return (np.arange(RUNS) < round(share * RUNS))[:, None]

    outcome = Outcome(
        values=np.full((RUNS, 1, 1), 1.1),
        standard_errors=np.full((RUNS, 1, 1), 0.1),
        robust=np.full((RUNS, 1, 1), np.nan),
        on_box=of_the_first(on_box),
        unusable=np.zeros((RUNS, 1), dtype=bool),
        objective=np.full((RUNS, 1), 2.0 + gap * SIGMA**2),
        optimum=np.full((RUNS, 1), 2.0),
        optimum_on_box=of_the_first(optimum_on_box),
        evaluations=np.ones((RUNS, 1)),
        delay=np.zeros((RUNS, 1)),
    )
    one = np.ones((1, 1))
    truth = Truth(("c1",), one, np.full((RUNS, 1, 1), 0.05), SIGMA, np.full(1, 1.96))
    moments = Moments.of(run_statistics(outcome, truth, (0,), None))
    return table_rows(moments, truth, (0,), Moments.of({"seconds": np.array([1e-3])}))


@pytest.mark.parametrize(("gap", "failed"), [(0.98, 0.0), (1.02, 1.0)])
def test_a_fit_fails_beyond_one_variance_of_the_noise_above_the_optimum(gap, failed):
    assert row_of(gap)["failure_share"] == failed


@pytest.mark.parametrize("where", ["on_box", "optimum_on_box"])
def test_an_efficiency_is_told_where_one_per_cent_of_the_runs_at_most_lie_on_the_box(where):
    assert row_of(**{where: 0.010})["rmse_over_crlb"] == pytest.approx(2.0)
    told = row_of(**{where: 0.0102})["rmse_over_crlb"]
    assert np.isnan(told).all()


def test_a_coverage_does_not_depend_on_how_the_runs_are_divided():
    """Three of eight estimates hold the truth; all that have an error are in the second half."""
    errors = np.array([np.nan] * 4 + [0.1, 0.1, 0.1, 0.01])[:, None, None]
    runs = np.zeros((8, 1))
    whole = Outcome(
        values=np.full((8, 1, 1), 1.1),
        standard_errors=errors,
        robust=np.full((8, 1, 1), np.nan),
        on_box=runs > 0,
        unusable=runs > 0,
        objective=runs,
        optimum=runs,
        optimum_on_box=runs > 0,
        evaluations=runs,
        delay=runs,
    )
    one = np.ones((1, 1))
    truth = Truth(("c1",), one, np.ones((8, 1, 1)), SIGMA, np.full(1, 1.96))
    parts = [Outcome(*(x[half] for x in whole)) for half in (slice(0, 4), slice(4, 8))]
    for outcomes in ([whole], parts):
        moments = [
            Moments.of(run_statistics(outcome, truth._replace(bound=errors), (0,), None))
            for outcome in outcomes
        ]
        together = reduce(partial(jax.tree.map, operator.add), moments)
        row = table_rows(together, truth, (0,), Moments.of({"seconds": np.array([1e-3])}))
        assert row["coverage95"] == pytest.approx(3 / 8)
        assert row["coverage95_se"] == pytest.approx(np.sqrt(3 / 8 * 5 / 8 / 7))
        assert np.isnan(row["coverage95_robust"])
