"""Names, numbers and axes of the reports."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from adhesion_jax.discovery.types import Interval
from adhesion_jax.report.discovery.words import (
    column_label,
    error,
    humanised,
    in_brackets,
)
from adhesion_jax.report.style import slip_axis
from adhesion_jax.wording import p_value, plus_minus

NAN = float("nan")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("humidity", "humidity"),
        ("slip_bias", "a bias of the slip"),
        ("covariate:wind_mps", "a dependence on wind_mps"),
        ("covariate:run_time_s", "a dependence on the time since the run began"),
        ("periodic:position_m", "a wave along position_m"),
        ("product:a:b", "a joint dependence on a:b"),
        ("new_kind:{}", "new kind of {}"),
    ],
)
def test_names_in_words(name, words):
    assert humanised(name) == words


@pytest.mark.parametrize(
    ("column", "label"),
    [
        ("slip_ratio", "slip ratio (1)"),
        ("acceleration_mps2", "acceleration (m/s^2)"),
        ("curvature_per_m", "curvature (1/m)"),
        ("normal_load_N", "normal load (N)"),
        ("run_order", "order of the runs (1)"),
        ("run_time_s", "time since the run began (s)"),
        ("wind_mps", "wind_mps"),
    ],
)
def test_columns_with_their_units(column, label):
    assert column_label(column) == label


def test_numbers_that_are_none_are_empty():
    assert error(NAN) == p_value(NAN) == plus_minus(NAN, 1.0) == in_brackets(Interval(*3 * [NAN]))
    assert in_brackets(Interval(106712.0, NAN, NAN)) == "106712"
    assert error(1.234e-7) == "1.234e-07"
    assert plus_minus(2.0, NAN) == "2"


@pytest.mark.parametrize("gap", [0.045, 0.13])
@pytest.mark.parametrize("span", [(0.0, 0.2), (-0.2, 0.2), (-0.003, 0.9), (0.0, 4.1)])
def test_ticks_of_slip_keep_apart(gap, span):
    axis = Figure().subplots()
    slip_axis(axis, *span, gap=gap)
    ticks = axis.xaxis.get_major_locator()()
    places = axis.get_xaxis().get_transform().transform(np.array([*ticks, max(map(abs, span))]))
    assert 3 <= len(ticks) <= 25
    assert min(np.diff(places[:-1])) >= 0.99 * gap * places[-1]


def test_the_axis_of_slip_leaves_a_curve_its_slope_at_slip_nought():
    """A curve that is linear in slip is drawn straight about 0, and its rise is half as wide."""
    axis = Figure().subplots()
    slip_axis(axis, 0.0, 0.3)
    small = axis.get_xaxis().get_transform().transform(np.array([0.0, 0.002, 0.004, 0.03, 0.3]))
    assert small[2] / small[1] == pytest.approx(2.0, rel=0.03)
    assert 0.4 < small[3] / small[4] < 0.6
