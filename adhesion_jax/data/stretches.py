"""Rows of a log that follow each other in time: stretches, gaps, and clocks that step back."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise

import numpy as np
import pandas as pd

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


def jackknife(without: Sequence[float]) -> float:
    """The standard error of a value from those that are found without one part of a log each."""
    each = np.array(without)
    return float(np.sqrt((each.size - 1) / each.size * np.sum((each - each.mean()) ** 2)))


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


#: Rows within which a clock that stepped back shows again what it showed before.
_CAUGHT_UP = 10


def steps_in_runs(time: np.ndarray, series: np.ndarray) -> np.ndarray:
    """The time of each row less that of the row before in its run; NaN without one, [rows].

    `series` has the number of the run of each row.
    """
    return np.asarray(pd.Series(time).groupby(series).diff().to_numpy())


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
