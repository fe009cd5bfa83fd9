"""Rows and columns without a value: which are bridged or left out, and what is said of it."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from adhesion_jax.data.stretches import GAP_S, stretches
from adhesion_jax.wording import listed

#: Rows with a gap in a column that is not needed are left out, up to this share of all rows; up to
#: the second one for a search, to which every column may be the cause. By hand.
FEW, FEW_OF_A_SEARCH = 0.05, 0.2


class Gaps(NamedTuple):
    """The rows that are kept, [rows], bool; columns that are left out; and sentences on both."""

    kept: np.ndarray
    left_out: Mapping[str, str]  # each with the clause why
    notes: tuple[str, ...]


def bridged(
    columns: dict[str, np.ndarray], series: np.ndarray, names_needed: Sequence[str]
) -> tuple[str, ...]:
    """Fills short gaps of columns that are not needed, in place; sentences say of how many rows.

    A gap is short if the values before and after it, of one series [rows] in time and without a gap
    in time, are at most a second apart: a straight line between them is taken. Of a column of whole
    numbers, which may be states, it is only taken where both are the same.
    """
    time = columns.get("time_s")
    holed = [
        name
        for name in columns
        if name not in {*names_needed, "time_s"} and np.isnan(columns[name]).any()
    ]
    if time is None or not holed:
        return ()
    filled = dict.fromkeys(holed, 0)
    timed = np.flatnonzero(~np.isnan(time))
    for part in stretches(time[timed], series[timed]):
        at = time[timed[part]]
        for name in holed:
            values = columns[name][timed[part]]
            there = ~np.isnan(values)
            known, held = at[there], values[there]
            after = np.searchsorted(known, at)
            hole = np.flatnonzero(~there & (after > 0) & (after < known.size))
            if not hole.size:
                continue
            after = after[hole]
            short = known[after] - known[after - 1] < 1.001 * GAP_S
            if (held % 1 == 0).all():
                short &= held[after] == held[after - 1]
            values[hole[short]] = np.interp(at[hole[short]], known, held)
            columns[name][timed[part]] = values
            filled[name] += int(short.sum())
    return tuple(
        f"In {rows:,} of {time.size:,} rows there is no value of {name}: it is taken from a "
        f"straight line between its neighbours, at most {GAP_S:g} s apart."
        for name, rows in filled.items()
        if rows
    )


def without_gaps(
    columns: Mapping[str, np.ndarray], names_needed: Sequence[str], few: float
) -> Gaps:
    """The rows that have a value, not NaN, in every column that is kept.

    A row must have one in the columns that are needed. Of the others, those with the fewest gaps
    come first: as long as all that are kept cost at most the share `few` of the rows, the rows are
    left out, and then the column. Blank rows at the end are no rows, and not counted.
    """
    missing = {name: np.isnan(values) for name, values in columns.items()}
    blank = np.logical_and.reduce([*missing.values()])
    rows = blank.size - int((~blank[::-1]).argmax()) if not blank.all() else 0
    kept = ~np.logical_or.reduce([missing[name] for name in names_needed])
    notes: list[str] = []
    if not kept[:rows].all():
        holes = [name for name in names_needed if missing[name][:rows].any()]
        notes.append(f"{of_rows(~kept[:rows])} there is no value of {listed(holes, 'or')}.")
    left_out: dict[str, str] = {}
    further = sorted({*columns} - {*names_needed}, key=lambda one: (missing[one].sum(), one))
    allowed = (1 - few) * np.count_nonzero(kept)
    for name in further:
        without = kept & ~missing[name]
        lost = kept[:rows] & missing[name][:rows]
        if not lost.any():
            continue
        if np.count_nonzero(without) >= allowed:
            notes.append(f"{of_rows(lost)} there is no value of {name}.")
            kept = without
        else:
            share = 100 * missing[name][:rows].mean()
            left_out[name] = f"{share:.3g} % of its rows have no value"
    return Gaps(kept, left_out, tuple(notes))


def of_rows(rows: np.ndarray) -> str:
    """The beginning of a sentence on rows, [rows], bool, that are not used."""
    count = int(rows.sum())
    words = "is 1 row" if count == 1 else f"are {count:,} rows"
    return f"Not used {words} of {rows.size:,} ({100 * rows.mean():.3g} %), in which"
