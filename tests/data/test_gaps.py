"""Columns with gaps: which are bridged, which rows and columns are left out, and what is said."""

import numpy as np
import pandas as pd
import pytest

from adhesion_jax.data import to_measured, to_runs
from adhesion_jax.data.stretches import FEW_OF_A_SEARCH


def log(runs=4, rows=50):
    """Runs at 10 Hz; `wet` and `bad` are straight lines in time, `flag` is a state."""
    time = np.tile(0.1 * np.arange(rows), runs)
    run = np.repeat(np.arange(runs), rows)
    slip = 0.01 + 0.02 * time
    return pd.DataFrame(
        {
            "run": run,
            "time_s": time,
            "slip_ratio": slip,
            "adhesion": 0.3 * slip / (0.02 + slip),
            "wet": 60.5 + 3 * time + 10 * run,
            "flag": np.where(time > 2.45, 1.0, 0.0),
        }
    )


def test_a_slow_signal_is_bridged_by_straight_lines_within_its_runs():
    table = log()
    slow = table.assign(wet=table["wet"].where(table.index % 10 == 0))
    found = to_measured("log", slow)
    # Behind the last value of each run, at its row 40 of 50, there is none to go to.
    assert found.table.index.tolist() == list(range(200))
    why = "18 % of its rows have no value, and at most 5 % of all rows may"
    assert found.left_out == {"wet": why}
    assert f"The column wet is left out: {why}." in to_runs([found]).warnings
    found = to_measured("log", slow, few=FEW_OF_A_SEARCH)
    kept = found.table["time_s"] < 4.05
    assert kept.all()
    np.testing.assert_allclose(
        found.table["wet"], table["wet"][(table["time_s"] < 4.05).to_numpy()], atol=1e-9
    )
    assert found.gaps == (
        "In 144 of 200 rows there is no value of wet: it is taken from a straight line between its "
        "neighbours, at most 1 s apart.",
        "Not used are 36 rows of 200 (18 %), in which there is no value of wet.",
    )
    assert [words for words in to_runs([found]).warnings if words in found.gaps] == [*found.gaps]


def test_nothing_is_invented_over_a_longer_gap_or_between_states():
    table = log()
    hole = table["run"].eq(1) & table["time_s"].between(2.0, 3.0)
    found = to_measured("log", table.assign(wet=table["wet"].mask(hole)), few=FEW_OF_A_SEARCH)
    assert found.table.index.tolist() == table.index[~hole].tolist()
    assert found.gaps == (
        "Not used are 11 rows of 200 (5.5 %), in which there is no value of wet.",
    )
    # Where a state is the same on both sides it was that; where it changed nobody knows when.
    same, changed = table["time_s"].between(0.95, 1.25), table["time_s"].between(2.35, 2.55)
    found = to_measured("log", table.assign(flag=table["flag"].mask(same | changed)))
    assert set(found.table["flag"]) == {0.0, 1.0}
    assert len(found.table) == (~changed).sum()


def test_without_a_time_no_gap_is_bridged():
    table = log().drop(columns="time_s")
    found = to_measured("log", table.assign(wet=table["wet"].where(table.index % 50 != 7)))
    assert len(found.table) == 196
    assert found.gaps == ("Not used are 4 rows of 200 (2 %), in which there is no value of wet.",)


@pytest.mark.parametrize("share", [0.18, 0.22])
def test_a_search_uses_a_column_that_at_most_a_fifth_of_the_rows_lack(share):
    table = log(runs=50)
    table = table.assign(wet=table["wet"].mask(table["run"] < 50 * share))
    found = to_measured("log", table, few=FEW_OF_A_SEARCH)
    assert ("wet" in found.table) == (share < FEW_OF_A_SEARCH)
    assert found.table["run"].nunique() == (50 - 9 if share < FEW_OF_A_SEARCH else 50)
