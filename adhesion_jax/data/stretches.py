"""Rows of a log that follow each other in time: stretches, gaps, and clocks that step back."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pandas as pd

from adhesion_jax.data.gathering import MOST
from adhesion_jax.errors import InputError
from adhesion_jax.wording import listed

#: A step in time is a gap if it exceeds this multiple of the median step and this time.
GAP_STEPS, GAP_S = 10.0, 1.0


def series_of(labels: Mapping[str, pd.Categorical], rows: int) -> np.ndarray:
    """A number for each run and axle of the rows, [rows]: what is one signal in time."""
    series = np.zeros(rows, np.int64)
    for name in ("run", "axle"):
        if name in labels:
            series = series * (len(labels[name].categories) + 1) + labels[name].codes
    return series


def order_by(series: np.ndarray) -> np.ndarray | None:
    """The order that puts the rows of each series together; None if they lie so already."""
    if (series[1:] >= series[:-1]).all():
        return None
    return np.argsort(series, kind="stable")


def usual_step(time: np.ndarray, series: np.ndarray) -> float:
    """The median step in time within a series, of the steps that are not 0; 0 without any."""
    steps = np.diff(time)[series[1:] == series[:-1]]
    forward = steps[steps > 0]
    return float(np.median(forward)) if forward.size else 0.0


def longest_step(time: np.ndarray, series: np.ndarray) -> float:
    """The longest step in time within a series that is no gap, s."""
    return max(GAP_STEPS * usual_step(time, series), GAP_S)


def stretches(time: np.ndarray, series: np.ndarray) -> Iterator[np.ndarray]:
    """The places of the rows of each stretch, in the order of time, without a gap between them."""
    order = order_by(series)
    if order is not None:
        time, series = time[order], series[order]
    cut = (series[1:] != series[:-1]) | (np.diff(time) > longest_step(time, series))
    edges = np.concatenate([[0], 1 + np.flatnonzero(cut), [time.size]])
    for begin, end in pairwise(edges):
        yield np.arange(begin, end) if order is None else order[begin:end]


def slope_in_time(
    time: np.ndarray, values: np.ndarray, series: np.ndarray, half_s: float
) -> np.ndarray:
    """The slope of values [rows] per s; NaN in a stretch of fewer than three rows.

    It is the central difference over about `half_s` before and after a row, and at least over its
    neighbours; at the ends of a stretch it reaches to one side only.
    """
    step = usual_step(time, series)
    half = max(1, round(half_s / step)) if step > 0 else 1
    slope = np.full(time.size, np.nan)
    for rows in stretches(time, series):
        if rows.size < 3:
            continue
        place = np.arange(rows.size)
        before = rows[np.maximum(place - half, 0)]
        after = rows[np.minimum(place + half, rows.size - 1)]
        lasted = time[after] - time[before]
        passed = lasted > 0
        change = values[after] - values[before]
        slope[rows] = np.where(passed, change / np.where(passed, lasted, 1.0), 0.0)
    return slope


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


#: Rows within which a clock that stepped back shows again what it showed before.
_CAUGHT_UP = 10


def steps_in_runs(time: np.ndarray, series: np.ndarray) -> np.ndarray:
    """The time of each row less that of the row before in its run; NaN without one, [rows].

    `series` has the number of the run of each row.
    """
    steps: np.ndarray = pd.Series(time).groupby(series).diff().to_numpy()
    return steps


def going_on(time: np.ndarray, series: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time that does not decrease within a series; the rows that are used; and where it was cut.

    Times in s and numbers of their series [rows]. Where the clock steps back, and shows within ten
    rows what it showed before, the rows until then are not used, or the one row before that ran
    ahead. Where it does not, the log is cut: the times from there on are moved behind those before,
    with a gap between them that parts runs and stretches.
    """
    used = np.ones(time.size, bool)
    back = steps_in_runs(time, series) < 0
    if not back.any():
        return time, used, back
    order = order_by(series)
    place = np.arange(time.size) if order is None else order
    t, s, stepped = time[place], series[place], np.flatnonzero(back[place])
    before = np.maximum(stepped - 2, 0)
    ahead = (stepped >= 2) & (s[before] == s[stepped]) & (t[stepped] >= t[before])
    used[place[stepped[ahead] - 1]] = False
    stepped = stepped[~ahead]
    last = np.searchsorted(s, s[stepped], "right") - 1
    later = np.minimum(stepped + _CAUGHT_UP, last)
    cut = stepped[t[later] <= t[stepped - 1]]
    gap = 1.1 * longest_step(t, s)
    moved = np.zeros(t.size)
    moved[cut] = t[cut - 1] - t[cut] + gap
    # What is added in a series counts in it alone.
    added = pd.Series(moved).groupby(s).cumsum().to_numpy()
    t = np.where(used[place], t + added, -np.inf)
    highest = pd.Series(t).groupby(s).cummax().to_numpy()
    used[place] &= t >= highest
    whole = time.copy()
    whole[place] = np.where(np.isfinite(t), t, time[place])
    parted = np.zeros(time.size, bool)
    parted[place[cut]] = True
    return whole, used, parted


def with_clock(
    time: np.ndarray, series: np.ndarray, column: str, index: pd.Index
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """The same for the time of a log, which may be NaN: time, rows that are used, and sentences.

    `index` are the numbers that a user sees of the rows. InputError where the clock steps back all
    the time, or most rows would be lost.
    """
    timed = ~np.isnan(time)
    moved, of_those, parted = going_on(time[timed], series[timed])
    rows = np.flatnonzero(timed)
    lost, cuts = rows[~of_those], rows[parted]
    if not lost.size and not cuts.size:
        return time, np.ones(time.size, bool), []
    if lost.size + cuts.size > MOST * rows.size:
        first = min([*lost[:1], *cuts[:1]])
        raise InputError(
            f"column {column} decreases all the time, first in row {index[first]} (sort each run "
            "by time, and number the runs in a column run)"
        )
    notes = []
    used = np.ones(time.size, bool)
    used[lost] = False
    if lost.size:
        notes.append(
            f"{of_rows(~used)} the clock steps back, until it shows again what it showed before; "
            f"the first is row {index[lost[0]]}."
        )
    if cuts.size:
        others = f" and {cuts.size - 1:,} other rows" if cuts.size > 1 else ""
        notes.append(
            f"The time of column {column} begins anew in row {index[cuts[0]]}{others}: the log is "
            "cut there, and the times from there on are moved behind those before."
        )
    time = time.copy()
    time[timed] = moved
    return time, used, notes
