"""A clock that steps back: rows are left out until it caught up, or the log is cut there."""

from collections.abc import Callable

import numpy as np
import pandas as pd

from adhesion_jax.data.gaps import of_rows
from adhesion_jax.data.gathering import MOST
from adhesion_jax.data.stretches import longest_step, order_by
from adhesion_jax.errors import InputError

#: Rows within which a clock that stepped back shows again what it showed before.
_CAUGHT_UP = 10


def steps_in_runs(time: np.ndarray, series: np.ndarray) -> np.ndarray:
    """The time of each row less that of the row before in its run; NaN without one, [rows].

    `series` has the number of the run of each row.
    """
    order = order_by(series)
    if order is not None:
        time, series = time[order], series[order]
    steps = np.diff(time, prepend=np.nan)
    steps[1:][series[1:] != series[:-1]] = np.nan
    if order is not None:
        steps[order] = steps.copy()
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
    time: np.ndarray, series: np.ndarray, column: str, row_of: Callable[[int], int]
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """The same for the time of a log, which may be NaN: time, rows that are used, and sentences.

    `row_of` is the number that a user sees of a row. InputError where the clock steps back all the
    time, or most rows would be lost.
    """
    timed = ~np.isnan(time)
    moved, of_those, parted = going_on(time[timed], series[timed])
    rows = np.flatnonzero(timed)
    lost, cuts = rows[~of_those], rows[parted]
    if not lost.size and not cuts.size:
        return time, np.ones(time.size, bool), []
    if lost.size + cuts.size > MOST * rows.size:
        first = row_of(int(min([*lost[:1], *cuts[:1]])))
        raise InputError(
            f"column {column} decreases all the time, first in row {first} (sort each run by time, "
            "and number the runs in a column run)"
        )
    notes = []
    used = np.ones(time.size, bool)
    used[lost] = False
    if lost.size:
        notes.append(
            f"{of_rows(~used)} the clock steps back, until it shows again what it showed before; "
            f"the first is row {row_of(int(lost[0]))}."
        )
    if cuts.size:
        others = f" and {cuts.size - 1:,} other rows" if cuts.size > 1 else ""
        notes.append(
            f"The time of column {column} begins anew in row {row_of(int(cuts[0]))}{others}: the "
            "log is cut there, and the times from there on are moved behind those before."
        )
    time = time.copy()
    time[timed] = moved
    return time, used, notes
