"""Whether points depend on slip at all is told by how far medians of bins lie apart."""

import numpy as np
import pandas as pd
import pytest
from scipy.stats import binom, chi2

import adhesion_jax as aj
from adhesion_jax.data.plausible import bins_of
from adhesion_jax.measured.vetoes import Points, independent_of_slip


def points(slip, adhesion):
    nothing = np.zeros_like(slip)
    return Points(slip, adhesion, nothing, nothing, nothing)


def rising(slip, height=0.3, place=0.02):
    return height * 2 * (slip / place) / (1 + (slip / place) ** 2)


@pytest.mark.parametrize("count", [30, 60, 400])
def test_few_points_on_the_rise_show_that_adhesion_depends_on_slip(count):
    """A glance sees it: the noise of .02 is a fifteenth of the peak."""
    draws = np.random.default_rng(count)
    said = 0
    for _ in range(200):
        slip = 0.2 * draws.uniform(size=count) ** 2
        said += bool(independent_of_slip(points(slip, rising(slip) + draws.normal(0, 0.02, count))))
    assert said <= 200 * 0.01


@pytest.mark.long
def test_a_few_exact_points_on_both_sides_of_a_peak_are_a_curve():
    """The noise is a sixtieth of the peak; medians of two bins, one on either side, agree."""
    vetoed = 0
    for seed in range(8):
        draws = np.random.default_rng(seed)
        slip = draws.uniform(0, 0.1, 12)
        adhesion = rising(slip, place=0.03) + draws.normal(0, 0.005, 12)
        table = pd.DataFrame({"slip_ratio": slip, "adhesion": adhesion})
        vetoed += bool(aj.identify(table, "kiencke").vetoes)
    assert vetoed <= 1


@pytest.mark.parametrize("count", [5, 9, 12, 17, 60])
def test_every_row_is_in_one_bin_of_five_rows_or_more(count):
    bins = bins_of(np.random.default_rng(count).uniform(size=count))
    assert min(rows.size for rows in bins) >= 5
    np.testing.assert_array_equal(np.sort(np.concatenate(bins)), np.arange(count))


@pytest.mark.parametrize("count", [20, 60, 400])
@pytest.mark.parametrize("passes", [0, 6])
def test_noise_is_seldom_taken_for_a_dependence(count, passes):
    """Of slips by chance with white noise, and of six passes with noise of an AR(1) of .8."""
    draws = np.random.default_rng(count + passes)
    taken = 0
    for _ in range(200):
        slip, noise = 0.2 * draws.uniform(size=count), draws.normal(size=count)
        if passes:
            slip = 0.2 * np.abs(np.sin(np.linspace(0, passes * np.pi, count)))
            for row in range(1, count):
                noise[row] = 0.8 * noise[row - 1] + 0.6 * noise[row]
        taken += not independent_of_slip(points(slip, 0.2 + 0.03 * noise))
    assert taken <= binom.ppf(0.999, 200, 0.02)


def test_a_plateau_with_few_points_before_it_is_no_level():
    """A tenth of sixty points lie on the rise of .42 x / (1 + x^2)^.5, the noise is .008."""
    draws = np.random.default_rng(1)
    slip = np.sort(draws.uniform(0, 0.2, 60))
    adhesion = 0.42 * (slip / 0.02) / np.hypot(1, slip / 0.02) + draws.normal(0, 0.008, 60)
    found = aj.identify(
        pd.DataFrame({"slip_ratio": slip, "adhesion": adhesion}), ("kiencke", "polach")
    )
    assert found.vetoes == ()
    assert found.mu_max_interval[0] <= 0.42


def test_two_levels_differ_from_the_gap_on_that_the_chi_square_tells():
    """Of two bins of five points at d (-2 .. 2): MAD d, errors equal, chi^2 = gap^2/(2 error^2)."""
    slip, pattern = np.repeat([0.01, 0.1], 5), 0.01 * np.array([-2, 1, 0, -1, 2])
    # 1.4826 MAD is the standard deviation, 1.25 of it over sqrt(n) the error of a median; a line
    # takes two of five degrees of freedom.
    error = 1.25 * 1.4826 * 0.01 / np.sqrt(5) * np.sqrt(5 / 3)
    gap = error * np.sqrt(2 * chi2.isf(1e-4, 1))
    for factor, independent in ((0.98, True), (1.02, False)):
        adhesion = np.concatenate([0.2 + pattern, 0.2 + factor * gap + pattern])
        assert bool(independent_of_slip(points(slip, adhesion))) == independent
