"""The expected slip against true slips that are known."""

import numpy as np
import pytest

from adhesion_jax.inference.weighing import expected_slip

NOISE = 0.0007


def drawn(seed, true, noise=NOISE):
    generator = np.random.default_rng(seed)
    true = generator.permutation(true)
    return true, true + noise * generator.normal(size=true.size)


def rolling_and_sweeps(seed):
    """Two thirds of the rows roll at slip 0; the slips of the others are spread to .1."""
    return drawn(seed, np.concatenate([np.zeros(8000), np.linspace(0.0, 0.1, 4000)]))


def test_an_exact_slip_is_expected_as_it_is():
    slip = np.linspace(0.0, 0.1, 50)
    mean, scatter = expected_slip(slip, np.zeros(50))
    np.testing.assert_array_equal(mean, slip)
    assert not scatter.any()


def test_of_evenly_spread_slips_the_measured_one_is_expected():
    _, slip = drawn(1, np.linspace(0.0, 0.1, 12_000))
    mean, scatter = expected_slip(slip, np.full(slip.size, NOISE))
    inner = (slip > 0.01) & (slip < 0.09)
    assert np.sqrt(np.mean((mean - slip)[inner] ** 2)) < 0.15 * NOISE
    assert np.median(scatter[inner]) == pytest.approx(NOISE, rel=0.05)
    # At the ends of the range there is none beyond.
    assert np.all(mean[slip < -2 * NOISE] > slip[slip < -2 * NOISE] + NOISE)


def test_beside_a_crowd_of_rolling_rows_the_expected_slip_is_the_mean_of_the_true_ones():
    true, slip = rolling_and_sweeps(2)
    mean, scatter = expected_slip(slip, np.full(slip.size, NOISE))
    measured = []
    for low in np.arange(-3.0, 8.0) * NOISE:
        here = (slip >= low) & (slip < low + NOISE)
        error = true[here].std() / np.sqrt(here.sum()) + 0.1 * NOISE
        assert abs(mean[here].mean() - true[here].mean()) < 3 * error
        measured.append(abs(slip[here].mean() - true[here].mean()) / error)
    assert max(measured) > 15
    z = (true - mean) / np.maximum(scatter, 0.1 * NOISE)
    assert 0.4 < np.sqrt(np.mean(z[slip > 3 * NOISE] ** 2)) < 1.2


def test_each_row_has_its_own_noise():
    noise = np.random.default_rng(3).uniform(0.0004, 0.002, 12_000)
    true, slip = drawn(4, np.concatenate([np.zeros(8000), np.linspace(0.0, 0.1, 4000)]), noise)
    mean, scatter = expected_slip(slip, noise)
    assert np.mean((mean - true) ** 2) < 0.5 * np.mean((slip - true) ** 2)
    far = (slip > 0.02) & (slip < 0.095)
    np.testing.assert_allclose(scatter[far], noise[far], rtol=0.25)
    # A number of rows has no part in it, but for the density.
    few, _ = expected_slip(slip[::2], noise[::2])
    assert np.sqrt(np.mean((few - mean[::2]) ** 2)) < 0.2 * NOISE
