"""Errors before and after, and how wide their intervals are."""

import numpy as np
import pytest
import scipy.stats

from adhesion_jax.discovery.findings.errors_by_run import errors

POINTS = 400


@pytest.mark.parametrize("runs", [8, 12, 28])
def test_intervals_are_as_wide_as_those_of_student(runs):
    """Of many points a run the mean squared errors are normal, and their mean has Student's t."""
    widths, of_student = [], []
    for seed in range(40):
        draw = np.random.default_rng([seed, runs])
        squares = 1 + 0.05 * draw.standard_normal(runs)
        after = errors(2 * POINTS * squares, POINTS * squares, np.full(runs, POINTS), seed).after
        assert after.value**2 == pytest.approx(squares.mean())
        widths.append(after.high**2 - after.low**2)
        of_student.append(
            2 * scipy.stats.t.isf(0.025, runs - 1) * squares.std(ddof=1) / np.sqrt(runs)
        )
    assert np.mean(widths) == pytest.approx(np.mean(of_student), rel=0.04)


def test_of_two_runs_the_interval_reaches_from_one_to_the_other():
    after = errors(np.array([8.0, 18.0]), np.array([2.0, 8.0]), np.full(2, 2.0), 0).after
    assert (after.low, after.high) == (1.0, 2.0)
