"""Pieces of work that are timed in turn, and the table of their rates."""

import time
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

#: The columns of the table of rates.
COLUMNS = (
    *("part", "name", "unit", "rate", "lowest", "highest"),
    *("peer", "ratio", "ratio_lowest", "ratio_highest"),
    *("compile_seconds", "memory_mb", "remark"),
)

#: A piece of work: its amount, and the seconds that it took, in the turn of this number. They are
#: CPU-seconds of this process; where another processor takes part, they are seconds by the clock.
Work = Callable[[int], tuple[float, float]]

#: Work is done again in its turn until it has taken this long: the first milliseconds after other
#: work are slower, by a third and more.
_LEAST_SECONDS = 0.2


class Timed(NamedTuple):
    """Work that is timed; without it, a sentence that says why it is not."""

    work: Work | None
    remark: str = ""
    compile_seconds: float = np.nan


def timed(
    function: Callable[[], Any], amount: int, clock: Callable[[], float] = time.process_time
) -> Work:
    """Work of a function that takes no arguments and always does the same."""

    def work(_: int) -> tuple[float, float]:
        began = clock()
        function()
        return float(amount), clock() - began

    return work


def rates(
    part: str,
    unit: str,
    peer: str,
    entries: Mapping[str, Timed],
    turns: int,
    progress: Callable[[str], None],
) -> pd.DataFrame:
    """The rate of each entry, in amounts per second: the median of the turns, and its range.

    The entries take turns, so that a machine whose speed drifts is fair to all, after one that is
    not counted. A ratio is that of two rates of one turn; the median of the turns is reported.
    """
    seen: dict[str, list[float]] = {name: [] for name in entries}
    for turn in range(turns + 1):
        for name, entry in entries.items():
            if entry.work is None:
                continue
            amount, seconds = _for_long(entry.work, turn)
            if turn > 0:
                seen[name].append(amount / seconds)
            progress(name)
    rows = []
    for name, entry in entries.items():
        row: dict[str, Any] = {"part": part, "name": name, "unit": unit, "peer": peer}
        row["remark"] = entry.remark
        row["compile_seconds"] = entry.compile_seconds
        if entry.work is not None:
            own = np.array(seen[name])
            row |= dict(zip(("lowest", "rate", "highest"), _spread(own), strict=True))
            if seen.get(peer):
                ratio = _spread(own / np.array(seen[peer]))
                row |= dict(zip(("ratio_lowest", "ratio", "ratio_highest"), ratio, strict=True))
        rows.append(row)
    return pd.DataFrame(rows).reindex(columns=COLUMNS)


def _for_long(work: Work, turn: int) -> tuple[float, float]:
    """The work of a turn, done again until it has taken so long that the clock tells it well."""
    amount = seconds = 0.0
    while seconds < _LEAST_SECONDS:
        more, longer = work(turn)
        amount, seconds = amount + more, seconds + longer
    return amount, seconds


def _spread(values: np.ndarray) -> tuple[float, float, float]:
    return float(values.min()), float(np.median(values)), float(values.max())
