"""Quantiles from counts against those of NumPy from the values themselves."""

import numpy as np
import pytest

from adhesion_jax.metrics.counts import (
    BINS,
    WIDTH,
    bins_of,
    edges,
    middles,
    quantile,
    rebinned,
    share_bins_of,
    share_middles,
)

SHARES = (0.0, 0.05, 0.31, 0.5, 0.95, 1.0)


@pytest.mark.parametrize("runs", [1, 2, 7, 1000])
def test_quantiles_of_whole_numbers_are_exact(runs):
    values = np.random.default_rng(runs).poisson(7, runs)
    counts = np.bincount(values, minlength=60)
    for share in SHARES:
        found = quantile(counts, np.arange(60.0), share)
        assert found == pytest.approx(np.quantile(values, share), rel=1e-12)


@pytest.mark.parametrize("spread", [0.3, 1.0, 40.0, 3000.0])
def test_quantiles_of_estimates_are_right_to_half_a_bin(spread):
    random = np.random.default_rng(4)
    centre, scale = np.array([0.8, -3.0]), np.array([0.01, 2.0])
    values = centre + scale * spread * random.standard_t(3, (5000, 2))
    bins = bins_of(values, centre, scale)
    counts = np.stack([np.bincount(of, minlength=BINS) for of in bins.T])
    for share in SHARES[1:-1]:
        found = quantile(counts, middles(centre, scale), share)
        true = np.quantile(values, share, axis=0)
        half = 0.5 * WIDTH * np.hypot(scale, true - centre)
        assert (np.abs(found - true) <= 1.01 * half).all()


def test_the_bins_are_as_wide_as_the_docs_say():
    """0.005 times the root of bound^2 + d^2 at the distance d from the truth."""
    middle = middles(np.array(0.8), np.array(0.01))
    wide = np.diff(edges(0.8, 0.01))
    np.testing.assert_allclose(wide, 0.005 * np.hypot(0.01, middle - 0.8), rtol=1e-4)


def test_what_is_no_number_is_told_apart_and_what_is_too_large_is_in_the_last_bin():
    values = np.array([np.nan, np.inf, -np.inf, 1e300, 0.0])
    bins = bins_of(values, np.array(0.0), np.array(1.0))
    assert bins.tolist() == [BINS, BINS - 1, 0, BINS - 1, BINS // 2]
    assert np.isnan(quantile(np.zeros((2, BINS), dtype=int), np.zeros((2, BINS)), 0.5)).all()


def test_shares_that_are_thousandths_are_exact():
    values = np.array([0.0, 0.98, 0.98, 0.997, 1.0])
    counts = np.bincount(share_bins_of(values), minlength=BINS)
    for share in SHARES:
        found = quantile(counts, share_middles(), share)
        assert found == pytest.approx(np.quantile(values, share))


def test_counts_in_wider_bins_are_those_of_the_values():
    values = np.random.default_rng(1).normal(0.8, 0.01, 200_000)
    counts = np.bincount(bins_of(values, np.array(0.8), np.array(0.01)), minlength=BINS)
    lines = np.linspace(0.76, 0.84, 41)
    found, true = rebinned(counts, edges(0.8, 0.01), lines), np.histogram(values, lines)[0]
    # At each line at most the runs of one narrow bin stand on the wrong side.
    assert np.abs(found - true).max() <= 2 * counts.max()
    assert np.abs(found - true).max() < 0.02 * true.max()
    assert found.sum() == pytest.approx(true.sum(), abs=int(counts.max()))
