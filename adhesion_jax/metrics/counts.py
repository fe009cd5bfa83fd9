"""Numbers of runs in fixed bins: what adds up exactly, in any order, where quantiles do not.

An estimate x of a quantity with the true value c falls into the bin with the number
round(asinh((x - c) / s) / WIDTH), in which s is a scale of the quantity: the bins are WIDTH s wide
near the truth, and WIDTH times the distance far from it. A quantile is the middle of its bin, so
that its error is at most half of that. Whole numbers have a bin each, and exact quantiles.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Counts = NDArray[np.int64]

#: Width of a bin near the truth, in scales of the quantity.
WIDTH = 0.005

#: Bins on either side of the truth; the last ones hold all that lies beyond (11,000 scales).
REACH = 2000

BINS = 2 * REACH + 1

#: Numbers from 0 to 1 are counted in bins of this width about its multiples.
SHARE_WIDTH = 0.001


def bins_of(values: Array, centre: Array, scale: Array) -> Counts:
    """The bin of each value, from 0 to BINS - 1; BINS where the value is no number."""
    place = np.rint(np.arcsinh((values - centre) / scale) / WIDTH)
    return _inside(place + REACH)


def middles(centre: Array, scale: Array) -> Array:
    """The middle of each bin, [..., BINS]."""
    steps = np.sinh(WIDTH * np.arange(-REACH, REACH + 1))
    return np.asarray(centre[..., None] + scale[..., None] * steps)


def edges(centre: float, scale: float) -> Array:
    """The edges of the bins, [BINS + 1]."""
    return np.asarray(centre + scale * np.sinh(WIDTH * (np.arange(BINS + 1) - REACH - 0.5)))


def share_bins_of(values: Array) -> Counts:
    """The same for numbers from 0 to 1."""
    return _inside(np.rint(values / SHARE_WIDTH))


def share_middles() -> Array:
    return np.asarray(SHARE_WIDTH * np.arange(BINS))


def _inside(place: Array) -> Counts:
    return np.where(np.isnan(place), BINS, np.clip(place, 0, BINS - 1)).astype(np.int64)


def quantile(counts: NDArray[np.integer], middle: Array, share: float) -> Array:
    """The quantile of values that were counted, [...] from [..., bins]; NaN where none was.

    Between two values it is interpolated as by `numpy.quantile`.
    """
    below = np.cumsum(counts, axis=-1, dtype=np.int64)
    number = below[..., -1:]
    last = np.maximum(number - 1, 0)
    rank = share * last
    low = np.floor(rank)

    def of_rank(rank: Array) -> Array:
        place = np.sum(below <= rank, axis=-1, keepdims=True)
        place = np.minimum(place, counts.shape[-1] - 1)
        return np.take_along_axis(np.broadcast_to(middle, counts.shape), place, axis=-1)

    first, second = of_rank(low), of_rank(np.minimum(low + 1, last))
    found = first + (rank - low) * (second - first)
    return np.asarray(np.where(number > 0, found, np.nan)[..., 0])


def rebinned(counts: NDArray[np.integer], old: Array, new: Array) -> Array:
    """Numbers in other bins, as if values were spread evenly over each of their own bins."""
    below = np.concatenate([[0], np.cumsum(counts)])
    return np.asarray(np.diff(np.interp(new, old, below)))
