"""Blocks of rows: their means, their number, what they are worth, and where they are short."""

import numpy as np
import pandas as pd
import pytest
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from adhesion_jax.data.condensing import (
    alike,
    block_means,
    condensed,
    correlation_of,
    hidden_shares,
    independent,
)
from adhesion_jax.data.reading import to_measured
from adhesion_jax.data.runs import to_runs


def runs_of(table):
    return to_runs([to_measured("table", table)])


def sweeps(lengths, **columns):
    """Runs of a rising slip, as many rows each as `lengths` says."""
    run = np.repeat(np.arange(len(lengths)), lengths)
    slip = np.concatenate([0.01 + 0.0002 * np.arange(length) for length in lengths])
    return pd.DataFrame({"run": run, "slip_ratio": slip, "adhesion": 2 * slip, **columns})


def test_few_rows_stay_as_they_are():
    runs = runs_of(sweeps([30, 40]))
    assert condensed(runs, 70) is runs
    assert condensed(runs, 69) is not runs
    assert (runs.weights == 1).all()


def test_a_block_has_the_means_of_its_rows_and_lies_in_one_run():
    draw = np.random.default_rng(0)
    table = sweeps([1000, 500, 37, 1], wear=draw.normal(size=1538))
    runs = runs_of(table)
    blocks = condensed(runs, 150)
    assert 140 <= blocks.whole.slip.size <= 160
    ends = [*blocks.places[1:], len(table)]
    for place, (first, end) in enumerate(zip(blocks.places, ends, strict=True)):
        rows = table.iloc[first:end]
        assert len({*rows["run"]}) == 1
        assert blocks.whole.slip[place] == pytest.approx(rows["slip_ratio"].mean(), rel=1e-12)
        assert blocks.whole.conditions["wear"][place] == pytest.approx(rows["wear"].mean())
    assert blocks.lengths.sum() == blocks.whole.slip.size
    assert (table["run"].iloc[blocks.places[blocks.starts]] == [0, 1, 2, 3]).all()
    # Other values of the same rows go into the same blocks, wherever they move.
    moved = np.where(table["wear"] > 1, 5.0, 1.0) * runs.whole.slip
    other = alike(runs._replace(whole=runs.whole._replace(slip=moved)), blocks)
    np.testing.assert_allclose(other.whole.slip, block_means(moved, runs, blocks), rtol=1e-12)
    assert (other.places == blocks.places).all()
    assert alike(runs, runs) is runs
    # A steady sweep is cut evenly.
    sizes = np.diff(blocks.places)[: blocks.lengths[0] - 1]
    assert sizes.max() - sizes.min() <= 1
    np.testing.assert_allclose(
        block_means(table["wear"].to_numpy(), runs, blocks), blocks.whole.conditions["wear"]
    )


def test_a_slip_event_in_a_long_log_keeps_its_shape():
    """8 s in 67 min: its rows are one in 500, and it gets a good part of the blocks of its run."""
    slip = np.full(400_000, 0.004)
    event = slice(200_000, 200_800)
    slip[event] += 0.15 * np.sin(np.linspace(0, np.pi, 800))
    slip += 0.0005 * np.random.default_rng(1).normal(size=slip.size)
    table = pd.DataFrame(
        {"slip_ratio": slip, "adhesion": slip, "run": np.arange(400_000) // 50_000}
    )
    blocks = condensed(runs_of(table))
    inside = (blocks.places >= event.start) & (blocks.places < event.stop)
    assert inside.sum() > 200
    assert np.ptp(blocks.whole.slip[inside]) > 0.149
    # What is calm keeps half of the blocks: 8000 in all would be of 50 rows.
    assert np.diff(blocks.places, append=slip.size).max() < 2.5 * 50


@pytest.mark.parametrize("most", [150, 600, 1250, 2500])
def test_no_stretch_has_more_blocks_than_rows(most):
    """Where slip jumps and its noise is small, single rows would have several blocks each."""
    draw = np.random.default_rng(5)
    levels = np.repeat(draw.uniform(0.01, 0.2, 50), 100)
    slip = levels + 1e-5 * draw.normal(size=5000)
    table = pd.DataFrame({"slip_ratio": slip, "adhesion": slip, "run": np.arange(5000) // 500})
    blocks = condensed(runs_of(table), most)
    assert blocks.whole.slip.size == pytest.approx(most, rel=0.03)
    # What is calm keeps half of the blocks.
    assert np.diff(blocks.places, append=5000).max() < 2.5 * 5000 / most
    # A large jump lies at the edge of two blocks, or in a block that is shorter than most.
    for jump in 100 * (1 + np.flatnonzero(np.abs(np.diff(levels[::100])) > 0.05)):
        place = np.searchsorted(blocks.places, jump, side="right") - 1
        length = np.diff(blocks.places, append=5000)[place]
        assert blocks.places[place] == jump or length <= max(2, 5000 // most)


def test_runs_of_very_different_length_do_not_fill_the_memory():
    blocks = condensed(runs_of(sweeps([5_000, *[20] * 4000]).assign(slip_ratio=0.1)))
    assert blocks.lengths.size * blocks.lengths.max() <= 32_000
    assert (blocks.lengths >= 1).all()


@pytest.mark.parametrize("r", [0.0, 0.5, 0.95])
def test_a_block_is_worth_its_independent_rows(r):
    """The variance of the mean of n rows is the sum of their covariance matrix over n^2."""
    for n in (1, 2, 7, 60):
        variance = toeplitz(r ** np.arange(n)).sum() / n**2
        (found,) = independent(np.array([float(n)]), r)
        assert found == pytest.approx(1 / variance, rel=1e-12)


@pytest.mark.parametrize("r", [0.0, 0.5, 0.9])
def test_the_correlation_of_rows_on_a_smooth_signal_with_jumps(r):
    noise = np.random.default_rng(3).normal(size=200_000)
    noise = 0.01 * lfilter([np.sqrt(1 - r**2)], [1, -r], noise)
    signal = 0.3 * np.sin(np.arange(200_000) / 500) + (np.arange(200_000) // 4000) % 2
    found = correlation_of(signal + noise, np.array([0, 10_000]))
    assert found == pytest.approx(r, abs=0.03)


def test_axles_in_turn_are_not_averaged():
    table = sweeps([4000]).assign(axle=np.tile([1, 2, 3, 4], 1000), run="a")
    table = pd.concat([table, table.assign(run="b")], ignore_index=True)
    table["adhesion"] = 0.1 * table["axle"]
    runs = runs_of(table)
    blocks = condensed(runs, 400)
    codes = blocks.whole.conditions["axle"]
    # Other values of the rows are averaged over the same ones, such as what a law predicts.
    np.testing.assert_array_equal(
        block_means(2 * runs.whole.adhesion, runs, blocks), 2 * blocks.whole.adhesion
    )
    assert {*codes} == {0.0, 1.0, 2.0, 3.0}
    np.testing.assert_allclose(blocks.whole.adhesion, 0.1 * (codes + 1), rtol=1e-12)
    assert np.bincount(codes.astype(int)).min() > 60


def test_how_much_of_a_column_is_within_blocks():
    phase = np.arange(8000) * 2 * np.pi / 8000
    table = sweeps([4000, 4000], slow=np.sin(phase), fast=np.sin(1000 * phase))
    runs = runs_of(table)
    shares = hidden_shares(runs, condensed(runs, 200))
    assert shares["slow"] < 0.01
    assert shares["fast"] > 0.99
