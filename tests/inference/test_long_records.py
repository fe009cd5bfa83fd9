"""Rows of long records, taken in stretches."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from adhesion_jax.inference.rows import arranged, in_stretches
from adhesion_jax.records import Record


@pytest.mark.parametrize("lengths", [(50_000,), (20_000, 30, 9_970, 20_000), (40,) * 1250])
def test_stretches_of_a_long_record_are_whole_and_join_no_rows_that_are_apart(lengths):
    rows = sum(lengths)
    run = np.repeat(np.arange(len(lengths)), lengths)
    number = np.arange(rows, dtype=float)
    record = Record(number, -number, None, None, {"time_s": number})
    whole = arranged(record, run, ())

    some, chosen = in_stretches(whole, 10_000)

    assert some.slip.size == pytest.approx(10_000, rel=0.05)
    assert_array_equal(some.slip, number[chosen])
    assert_array_equal(some.adhesion, -number[chosen])
    blocks = np.searchsorted(whole.blocks, chosen, side="right") - 1
    for block in np.unique(blocks):  # of each block all rows or none
        assert np.sum(blocks == block) == np.diff(whole.blocks)[block]
    follows = (np.diff(chosen) == 1) & (run[chosen[1:]] == run[chosen[:-1]])
    assert_array_equal(np.diff(some.run) == 0, follows)
    assert (chosen[0], chosen[-1]) == (0, rows - 1)  # from the beginning to the end


def test_a_record_that_is_not_long_is_taken_as_it_is():
    record = Record(np.arange(100.0), np.arange(100.0), None, None, {"time_s": np.arange(100.0)})
    whole = arranged(record, np.zeros(100, int), ())

    some, chosen = in_stretches(whole, 100)

    assert some is whole
    assert chosen == slice(None)
