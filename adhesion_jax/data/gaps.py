"""Rows and columns without a value: which are left out, and what is said of it."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from adhesion_jax.wording import listed

#: Rows with a gap in a column that is not needed are left out, up to this share of all rows.
_FEW = 0.05


class Gaps(NamedTuple):
    """The rows that are kept, [rows], bool; columns that are left out; and sentences on both."""

    kept: np.ndarray
    left_out: tuple[str, ...]
    notes: tuple[str, ...]


def without_gaps(columns: Mapping[str, np.ndarray], names_needed: Sequence[str]) -> Gaps:
    """The rows that have a value, not NaN, in every column that is kept.

    A row must have one in the columns that are needed. Of the others, those with the fewest gaps
    come first: as long as all that are kept cost at most 5 % of the rows, the rows are left out,
    and then the column. Blank rows at the end are no rows, and not counted.
    """
    missing = {name: np.isnan(values) for name, values in columns.items()}
    blank = np.logical_and.reduce([*missing.values()])
    rows = blank.size - int((~blank[::-1]).argmax()) if not blank.all() else 0
    kept = ~np.logical_or.reduce([missing[name] for name in names_needed])
    notes: list[str] = []
    if not kept[:rows].all():
        holes = [name for name in names_needed if missing[name][:rows].any()]
        notes.append(f"{of_rows(~kept[:rows])} there is no value of {listed(holes, 'or')}.")
    left_out: list[str] = []
    further = sorted({*columns} - {*names_needed}, key=lambda one: (missing[one].sum(), one))
    allowed = (1 - _FEW) * np.count_nonzero(kept)
    for name in further:
        without = kept & ~missing[name]
        lost = kept[:rows] & missing[name][:rows]
        if not lost.any():
            continue
        if np.count_nonzero(without) >= allowed:
            notes.append(f"{of_rows(lost)} there is no value of {name}.")
            kept = without
        else:
            left_out.append(name)
            share = 100 * missing[name][:rows].mean()
            notes.append(f"The column {name} is left out: {share:.3g} % of its rows have no value.")
    return Gaps(kept, tuple(left_out), tuple(notes))


def of_rows(rows: np.ndarray) -> str:
    """The beginning of a sentence on rows, [rows], bool, that are not used."""
    count = int(rows.sum())
    words = "is 1 row" if count == 1 else f"are {count:,} rows"
    return f"Not used {words} of {rows.size:,} ({100 * rows.mean():.3g} %), in which"
