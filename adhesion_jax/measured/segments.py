"""The rows of a measured record in stretches of equal length, each within one run."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Array, Bool, Float, Int

from adhesion_jax.records import Record

#: Longest stretch: what is computed for one is all that is held at a time.
_LONGEST = 4096

#: Parts that a single run is cut into, and those of points whose order in time is not known: what
#: is left out to judge a curve.
_PARTS = 12


class Segments(NamedTuple):
    """The points of a record, [segments, 1 + length]; the first is the last of the stretch before.

    `run` counts the runs from 0, or the parts that take their place where there is one run only.
    """

    slip: Float[Array, "segments points"]
    adhesion: Float[Array, "segments points"]
    conditions: Mapping[str, Float[Array, "segments points"]]
    valid: Bool[Array, "segments points"]  # the first is valid where it is of the same run
    run: Int[Array, " segments"]
    rows: Int[np.ndarray, "segments points"]  # of the record, -1 where there is none


class Grouping(NamedTuple):
    """Which points belong together, and what that allows to be estimated."""

    run: Int[np.ndarray, " points"]  # of each point, from 0
    ordered: bool  # whether the points of a run are in the order of time
    several: bool  # whether these are runs, which may differ in level, and not parts of one


def grouped(run: Int[np.ndarray, " points"], slip: np.ndarray, ordered: bool) -> Grouping:
    """Runs as they are; one run in parts: stretches in time, or every twelfth point in slip."""
    if run.max() > 0:
        return Grouping(run, ordered, True)
    points = run.size
    parts = min(_PARTS, points)
    if ordered:
        return Grouping(np.arange(points) * parts // points, True, False)
    part = np.empty(points, dtype=np.int64)
    part[np.argsort(np.abs(slip), kind="stable")] = np.arange(points) % parts
    return Grouping(part, False, False)


def segments(record: Record, needs: tuple[str, ...], grouping: Grouping) -> Segments:
    """The points of each run in their order, cut into stretches; the last is filled up."""
    run = grouping.run
    order = np.argsort(run, kind="stable")
    length = np.bincount(run)
    size = int(min(_LONGEST, max(length.max() if length.min() * 4 > length.max() else
                                 np.ceil(length.mean()), 1)))
    pieces = -(-length // size)
    first = np.cumsum(length) - length
    of_piece = np.repeat(np.arange(length.size), pieces)
    number = np.arange(of_piece.size) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    place = number[:, None] * size + np.arange(-1, size)
    inside = (place >= 0) & (place < length[of_piece][:, None])
    rows = np.where(inside, order[np.minimum(first[of_piece][:, None] + np.maximum(place, 0), run.size - 1)], -1)
    # Filled up with the first row of the run, at which every curve has a value.
    held = np.where(inside, rows, order[first[of_piece]][:, None])
    return Segments(
        np.asarray(record.slip)[held],
        np.asarray(record.adhesion)[held],
        {name: np.asarray(record.conditions[name])[held] for name in needs},
        inside,
        of_piece,
        rows,
    )
