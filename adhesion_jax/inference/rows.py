"""The rows of measured runs in their order, their weights by design, and blocks of them."""

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from adhesion_jax.records import Record

#: Rows, chosen evenly, by whose order the ends of groups are set.
_CHOSEN = 20_000


class Means(NamedTuple):
    """Weighted means of the rows of each group that has any weight, and the sum of the weights."""

    weight: Float[np.ndarray, " groups"]
    slip: Float[np.ndarray, " groups"]
    adhesion: Float[np.ndarray, " groups"]
    conditions: Mapping[str, Float[np.ndarray, " groups"]]
    square: Float[np.ndarray, " groups"]  # of the spread of the slip


def evenly(count: int, most: int) -> Int[np.ndarray, " chosen"]:
    """Numbers of evenly chosen rows of so many, at most this many."""
    return np.linspace(0, count - 1, min(count, most)).astype(int)


def of_like(
    slip: Float[np.ndarray, " rows"],
    conditions: Mapping[str, Float[np.ndarray, " rows"]],
    alone: int,
    together: tuple[int, int],
) -> Int[np.ndarray, " rows"]:
    """The group of each row: by its slip `alone`, or by slip and the first condition `together`.

    The groups have about as many rows each.
    """
    if not conditions:
        return _place(slip, alone)
    other = next(iter(conditions.values()))
    return _place(slip, together[0]) * together[1] + _place(other, together[1])


def _place(column: np.ndarray, groups: int) -> np.ndarray:
    known = np.sort(column[evenly(column.size, _CHOSEN)])
    return np.searchsorted(known[evenly(known.size, groups)][1:], column, side="right")


def means(
    group: Int[np.ndarray, " rows"],
    weight: Float[np.ndarray, " rows"],
    slip: Float[np.ndarray, " rows"],
    adhesion: Float[np.ndarray, " rows"],
    conditions: Mapping[str, Float[np.ndarray, " rows"]],
    spread: Float[np.ndarray, " rows"],
) -> Means:
    total = np.bincount(group, weight)
    some = total > 0

    def mean(column: np.ndarray) -> np.ndarray:
        return np.bincount(group, weight * column)[some] / total[some]

    of_conditions = {name: mean(column) for name, column in conditions.items()}
    square = mean(spread**2) if spread.any() else np.zeros(int(some.sum()))
    return Means(total[some], mean(slip), mean(adhesion), of_conditions, square)


#: Most blocks whose sums are kept, and most runs that count as clusters of their own: memory and
#: the time of a covariance do not grow with the length of a log.
_MOST_BLOCKS, _MOST_CLUSTERS = 600, 200

#: The column of the standard deviations that a table gives with its points.
_ERROR_BARS = "adhesion_sd"


class Rows(NamedTuple):
    """Rows by run, and in the order of time within a run.

    A block is a stretch of one run, or several short runs; a cluster is a run, or several. What is
    not independent of its neighbours is so within a cluster at most, if there are several runs.
    """

    slip: Float[np.ndarray, " rows"]
    adhesion: Float[np.ndarray, " rows"]
    conditions: Mapping[str, Float[np.ndarray, " rows"]]
    design: Float[np.ndarray, " rows"]  # relative precision of a row: 1 for all without error bars
    starts: Int[np.ndarray, " edges"]  # first rows of the runs, and the number of rows
    blocks: Int[np.ndarray, " edges_of_blocks"]  # first rows of the blocks, and the number of rows
    cluster: Int[np.ndarray, " blocks"]  # of each block
    ordered: bool  # whether the order of the rows within a run is that of time
    several: bool  # whether there are several runs

    @property
    def runs(self) -> int:
        return self.starts.size - 1

    @property
    def run(self) -> Int[np.ndarray, " rows"]:
        """The run of each row."""
        return np.repeat(np.arange(self.runs), np.diff(self.starts))

    @property
    def clusters(self) -> int:
        return int(self.cluster[-1]) + 1


def arranged(record: Record, run: Int[np.ndarray, " rows"], needed: Iterable[str]) -> Rows:
    """The rows by run, with the `needed` conditions.

    Points of no known order and no runs are independent: each is a block and a cluster.
    """
    ordered, several = "time_s" in record.conditions, bool(run.max() > 0)
    in_order = bool(np.all(run[1:] >= run[:-1]))
    order = slice(None) if in_order else np.argsort(run, kind="stable")
    starts = np.append(0, np.cumsum(np.bincount(run)))
    if ordered or several:
        blocks, of_run = _blocks(starts)
    else:
        blocks = np.unique(np.linspace(0, run.size, min(run.size, _MOST_BLOCKS) + 1).astype(int))
        of_run = np.arange(blocks.size - 1)
    clusters = int(of_run[-1]) + 1
    bars = record.conditions.get(_ERROR_BARS)
    design = np.ones(1) if bars is None else 1 / np.asarray(bars, float)[order] ** 2
    return Rows(
        np.asarray(record.slip)[order],
        np.asarray(record.adhesion)[order],
        {name: np.asarray(record.conditions[name])[order] for name in needed},
        np.broadcast_to(design / np.median(design), run.shape),
        starts,
        blocks,
        of_run * min(clusters, _MOST_CLUSTERS) // clusters,
        ordered,
        several,
    )


def _blocks(starts: Int[np.ndarray, " edges"]) -> tuple[np.ndarray, np.ndarray]:
    """The first rows of blocks of about equal length that end where runs end, and their runs."""
    rows, runs = int(starts[-1]), starts.size - 1
    if runs >= _MOST_BLOCKS:
        chosen = np.unique(np.linspace(0, runs, _MOST_BLOCKS + 1).astype(int))
        return starts[chosen], np.arange(chosen.size - 1)
    length = max(rows / (_MOST_BLOCKS - runs), 1.0)
    pieces = np.maximum(np.floor(np.diff(starts) / length).astype(int), 1)
    begins = [
        np.linspace(first, last, count + 1).astype(int)[:-1]
        for first, last, count in zip(starts[:-1], starts[1:], pieces.tolist(), strict=True)
    ]
    return np.append(np.concatenate(begins), rows), np.repeat(np.arange(runs), pieces)


def thinned(rows: Rows, most: int) -> Rows:
    """Evenly chosen rows, at most so many, for the search of the parameters."""
    if rows.slip.size <= most:
        return rows
    return _taken(rows, evenly(rows.slip.size, most))


def in_stretches(rows: Rows, most: int) -> tuple[Rows, slice | Int[np.ndarray, " chosen"]]:
    """Evenly chosen blocks, of about so many rows in all, and which rows these are.

    A block that does not follow upon the one chosen before it begins a run of its own.
    """
    if rows.slip.size <= most:
        return rows, slice(None)
    blocks = rows.blocks.size - 1
    some = np.linspace(0, blocks - 1, max(blocks * most // rows.slip.size, 1)).astype(int)
    spans = zip(rows.blocks[some], rows.blocks[some + 1], strict=True)
    chosen = np.concatenate([np.arange(*span) for span in spans])
    taken = _taken(rows, chosen)
    cuts = np.flatnonzero(np.diff(chosen) > 1) + 1
    return taken._replace(starts=np.unique(np.append(taken.starts, cuts))), chosen


def _taken(rows: Rows, chosen: Int[np.ndarray, " chosen"]) -> Rows:
    """These rows, in their order, of the same runs and blocks, of which some may become empty."""
    return rows._replace(
        slip=rows.slip[chosen],
        adhesion=rows.adhesion[chosen],
        conditions={name: column[chosen] for name, column in rows.conditions.items()},
        design=rows.design[chosen],
        starts=np.searchsorted(chosen, rows.starts),
        blocks=np.searchsorted(chosen, rows.blocks),
    )
