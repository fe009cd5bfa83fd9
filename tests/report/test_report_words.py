"""Names, numbers and axes of the reports."""

import math

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
from adhesion_jax.report.style import root_axis
from adhesion_jax.wording import p_value, plus_minus

NAN = float("nan")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("humidity", "humidity"),
        ("slip_bias", "a bias of the slip"),
        ("covariate:wind_mps", "a dependence on wind_mps"),
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
    root_axis(axis, *span, gap=gap)
    ticks = axis.xaxis.get_major_locator()()
    roots = [math.copysign(math.sqrt(abs(tick)), tick) for tick in ticks]
    assert 3 <= len(ticks) <= 25
    assert min(np.diff(roots)) >= 0.99 * gap * math.sqrt(max(map(abs, span)))
