"""Errors before and after, how wide their intervals are, and the levels of the runs."""

import numpy as np
import pytest
import scipy.stats
from discovery_campaigns import campaign, curve, runs_of

from adhesion_jax.discovery.findings.errors_by_run import errors
from adhesion_jax.discovery.findings.summary import _levels
from adhesion_jax.inference.noise import RunNoise

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


def test_levels_of_runs_stand_beside_labels_that_do_not_change_within_them():
    table = campaign(np.random.default_rng(3))
    place = table.groupby("run")["place"].first()
    level = place.map({"a": 1.2, "b": 1.0, "c": 0.9, "d": 0.8})
    law = curve(table["slip_ratio"]).to_numpy()
    half = np.where(np.arange(len(table)) % 2, "left", "right")
    runs = runs_of(table.assign(adhesion=law * level[table["run"]].to_numpy(), half=half))
    levels = _levels(runs, law, law, RunNoise(0.01))
    np.testing.assert_allclose(levels["after"], level - 1, atol=1e-12)
    assert [runs.named["place"][int(code)] for code in levels["place"]] == [*place]
    np.testing.assert_allclose(levels["warm"], table.groupby("run")["warm"].mean())
    assert {"left", "right"} == {*runs.named["half"]}
    assert "half" not in levels
