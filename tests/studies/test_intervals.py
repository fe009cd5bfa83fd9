"""The study of the intervals of an identification, and a part of it."""

import numpy as np
import pandas as pd
import pytest
from scipy.stats import binom

from adhesion_jax.runtime import silent
from experiments.intervals.coverage import (
    KNOWN_CELLS,
    UNKNOWN_CELLS,
    coverage_rates,
    coverage_study,
    drawn,
    truth_of,
)
from experiments.intervals.report import coverage_text, draw_coverage


def test_every_true_curve_has_its_peak_where_it_says():
    slip = np.linspace(0.0, 0.15, 150_001)
    for cell in (KNOWN_CELLS[0], *UNKNOWN_CELLS):
        truth = truth_of(cell)
        heights = truth.adhesion(slip)
        assert heights.max() == pytest.approx(truth.mu_max, rel=1e-6)
        # Near its top a curve is flat.
        assert slip[heights.argmax()] == pytest.approx(truth.slip_opt, abs=2e-4)
        assert heights[0] == pytest.approx(0.0, abs=1e-3)


def test_records_have_the_noise_of_their_cell():
    cell = KNOWN_CELLS[1]
    truth = truth_of(cell)
    record = drawn(cell, truth, 3)
    left = (np.asarray(record.adhesion) - truth.adhesion(np.asarray(record.slip))).reshape(12, 200)
    assert np.std(left) == pytest.approx(0.01, rel=0.1)
    assert np.corrcoef(left[:, 1:].ravel(), left[:, :-1].ravel())[0, 1] == pytest.approx(
        0.5, abs=0.1
    )
    again = drawn(cell, truth, 3)
    np.testing.assert_array_equal(record.adhesion, again.adhesion)


def test_rates_count_what_is_held(tmp_path):
    rows = pd.DataFrame(
        [
            {
                "truth": truth,
                "noise": "white",
                **dict.fromkeys(("mu_max", "slip_opt"), 1.0),
                **{f"{name}_true": 1.1 for name in ("mu_max", "slip_opt")},
                **{f"{name}_lo": 0.5 for name in ("mu_max", "slip_opt")},
                **{f"{name}_hi": high for name in ("mu_max", "slip_opt")},
                **{f"{name}_held": high > 1.1 for name in ("mu_max", "slip_opt")},
            }
            for truth, high in (("known", 1.5), ("known", 1.0), ("spline", 2.5), ("spline", 2.5))
        ]
    )
    rates = coverage_rates(rows).set_index(["truth", "quantity"])
    assert rates["coverage"]["known", "mu_max"] == 0.5
    assert rates["coverage"]["not among those fitted", "slip_opt"] == 1.0
    assert rates["bias"]["spline", "mu_max"] == pytest.approx(-0.1)
    assert rates["width_ratio"]["spline", "mu_max"] == pytest.approx(2.0 / 0.75)
    draw_coverage(tmp_path / "coverage.png", rates.reset_index())
    assert "not among those fitted" in coverage_text(rates.reset_index())


@pytest.mark.slow
@pytest.mark.parametrize("cell", KNOWN_CELLS, ids=lambda cell: cell.noise)
def test_the_intervals_hold_the_truth_in_every_noise(cell):
    rows = coverage_study([cell], 60, silent)
    # Fewer or more than this happens once in ten thousand if coverage is 95 %.
    low, high = binom.ppf([1e-4, 1 - 1e-4], 60, 0.95)
    assert low <= rows["mu_max_held"].sum() <= high
    # That of the slip has the doubt about the curve in it, and holds the truth more often.
    assert low <= rows["slip_opt_held"].sum()


@pytest.mark.slow
def test_the_intervals_hold_the_truth_of_curves_that_are_not_offered():
    rows = coverage_study(UNKNOWN_CELLS, 10, silent)
    for quantity in ("mu_max", "slip_opt"):
        assert rows[f"{quantity}_held"].sum() >= binom.ppf(1e-4, len(rows), 0.90)
