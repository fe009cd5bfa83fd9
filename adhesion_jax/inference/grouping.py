"""Groups of rows of like slip, whose means stand for them where a curve is searched."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

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
