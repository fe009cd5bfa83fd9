"""Blocks of neighbouring rows in the place of the rows, so that a search costs the same for all.

A block is a stretch of one run, and its values are the means of its rows. Half of the blocks of a
set are dealt out by the number of rows, so that every stretch keeps its share; half by how far the
slip moves in stretches where it moves faster than usual, so that a slip event of a few seconds in
hours of rolling is not averaged into one point. No stretch has more blocks than rows. If the slip
moves steadily all are dealt out by the number of rows.
"""

import numpy as np

from adhesion_jax.data.runs import Rows, RunSet

#: Largest number of points without condensing, and nearly the number of blocks with it.
MOST_POINTS = 8_000

#: Largest number of cells of one column when the runs lie side by side, padded to the longest one.
_MOST_CELLS = 4 * MOST_POINTS

#: A set of no more than MOST_POINTS rows is condensed only if it has more cells than this.
_ROOM = 500_000

#: The slip moves faster than usual where its change exceeds this multiple of the median change.
_FASTER = 3.0

#: The change of the slip is that from one piece of a run to the next, each the mean of so many rows
#: that this number of pieces makes up a block of mean length: noise of single rows is no movement.
_MEANS_A_BLOCK = 4

#: Numbers of stretches and of rows of each from which the autocorrelation of the rows is taken.
_STRETCHES, _ROWS_A_STRETCH = 100, 10_000

#: Largest autocorrelation of neighbouring rows that is taken into account.
_MOST_CORRELATED = 0.99


def condensed(runs: RunSet, most: int = MOST_POINTS) -> RunSet:
    """The runs as blocks of neighbouring rows, about `most` in all; small sets as they are.

    `places` of the result are the places of the first row of each block in `runs.whole`, and
    `worth` says how many independent rows a block is worth. In a block of several axles or modes
    the rows of one of them count, in turn.
    """
    lengths = runs.lengths
    count = runs.whole.slip.size
    if count <= most and lengths.size * lengths.max() <= _ROOM:
        return runs
    return _means(runs, *_cuts(runs, most))


def alike(runs: RunSet, blocks: RunSet) -> RunSet:
    """Other values of the rows that were condensed to `blocks`, in blocks of the same rows."""
    if blocks.whole.slip.size == runs.whole.slip.size:
        return runs
    return _means(runs, blocks.places, blocks.starts)


def _means(runs: RunSet, begins: np.ndarray, starts: np.ndarray) -> RunSet:
    """The blocks that begin at those rows, `starts` the first block of each run."""
    kept = _of_one_label(runs, begins)
    whole = runs.whole
    means = Rows(
        _mean(whole.slip, kept, begins),
        _mean(whole.adhesion, kept, begins),
        {name: _mean(values, kept, begins) for name, values in whole.conditions.items()},
    )
    own = np.add.reduceat(kept.astype(float), begins)
    worth = independent(own, correlation_of(whole.adhesion, runs.starts))
    return runs._replace(whole=means, starts=starts, places=begins, worth=worth)


def block_means(values: np.ndarray, runs: RunSet, blocks: RunSet) -> np.ndarray:
    """The means of values of all rows [rows] over the `blocks` that `runs` were condensed to.

    As in these, in a block of several axles or modes the rows of one of them count.
    """
    if blocks.whole.slip.size == values.size:
        return values
    return _mean(values, _of_one_label(runs, blocks.places), blocks.places)


def _mean(values: np.ndarray, kept: np.ndarray, begins: np.ndarray) -> np.ndarray:
    """The mean of the rows that are `kept`, [rows], of each block, [blocks]."""
    total = np.add.reduceat(np.where(kept, values, 0.0), begins)
    return total / np.add.reduceat(kept.astype(float), begins)


def independent(rows: np.ndarray, correlation: float) -> np.ndarray:
    """The number of independent rows whose mean is as sure as that of so many AR(1) ones.

    The variance of the mean of n rows of autocorrelation r is that of one row times
    ((1 + r)/(1 - r) - 2 r (1 - r^n)/(n (1 - r)^2))/n.
    """
    r = correlation
    inflation = (1 + r) / (1 - r) - 2 * r * (1 - r**rows) / (rows * (1 - r) ** 2)
    return rows / inflation


def correlation_of(adhesion: np.ndarray, starts: np.ndarray) -> float:
    """The autocorrelation of AR(1) noise on a smooth signal, from its differences in the runs.

    The differences of neighbours have the variance 2 s^2 (1 - r), those over two rows
    2 s^2 (1 - r^2): their ratio is 1 + r. Medians, which jumps of the signal do not move, stand for
    the variances.
    """
    last = max(adhesion.size - _ROWS_A_STRETCH, 0)
    stretch = np.arange(min(_ROWS_A_STRETCH, adhesion.size))
    at = np.unique(np.linspace(0, last, _STRETCHES).astype(int)[:, None] + stretch)[:-2]
    fresh = np.zeros(adhesion.size, dtype=bool)
    fresh[starts] = True
    at = at[~(fresh[at + 1] | fresh[at + 2])]
    one = np.abs(adhesion[at + 1] - adhesion[at])
    two = np.abs(adhesion[at + 2] - adhesion[at])
    if not two.size or not np.median(one) > 0:
        return 0.0
    ratio = (np.median(two) / np.median(one)) ** 2
    return float(np.clip(ratio - 1, 0.0, _MOST_CORRELATED))


def hidden_shares(runs: RunSet, blocks: RunSet) -> dict[str, float]:
    """The share of the variance of each varying condition that is within the blocks."""
    number = np.diff(blocks.places, append=runs.whole.slip.size)
    found = {}
    for name, values in runs.whole.conditions.items():
        spread = float(np.var(values))
        if name not in ("time_s", *_labels(runs)) and spread > 0:
            away = block_means(values, runs, blocks) - float(np.mean(values))
            found[name] = max(1 - float(np.average(away**2, weights=number)) / spread, 0.0)
    return found


def _cuts(runs: RunSet, most: int) -> tuple[np.ndarray, np.ndarray]:
    """The first row of each block [blocks], and the first block of each run [runs]."""
    lengths, starts = runs.lengths, runs.starts
    edges, share = _shares(runs, most)
    # The share of all rows before each edge of a piece; the edges of the runs are among them.
    ahead = np.concatenate([[0.0], np.cumsum(share)])
    of_runs = np.diff(ahead[np.searchsorted(edges, [*starts, edges[-1]])])
    cells = _MOST_CELLS // (2 if runs.blocks and "time_s" in runs.whole.conditions else 1)
    longest = max(cells // lengths.size, 1)
    wanted = np.clip(np.rint(most * of_runs), 1, np.minimum(lengths, longest)).astype(int)
    run = np.repeat(np.arange(lengths.size), wanted)
    turn = np.arange(run.size) - (np.cumsum(wanted) - wanted)[run]
    target = ahead[np.searchsorted(edges, starts)][run] + turn / wanted[run] * of_runs[run]
    begins = np.where(turn == 0, starts[run], np.interp(target, ahead, edges).astype(int))
    begins = np.unique(begins)
    return begins, np.searchsorted(begins, starts)


def _shares(runs: RunSet, most: int) -> tuple[np.ndarray, np.ndarray]:
    """The edges of short pieces of the runs [pieces + 1], and the share of the blocks of each."""
    slip, lengths = runs.whole.slip, runs.lengths
    width = max(slip.size // (_MEANS_A_BLOCK * most), 1)
    pieces = -(-lengths // width)
    run = np.repeat(np.arange(lengths.size), pieces)
    turn = np.arange(run.size) - (np.cumsum(pieces) - pieces)[run]
    edges = np.append(runs.starts[run] + width * turn, slip.size)
    number = np.diff(edges)
    moved = np.abs(np.diff(np.add.reduceat(slip, edges[:-1]) / number))
    # From one run to the next the slip does not move.
    within = run[1:] == run[:-1]
    usual = float(np.median(moved[within])) if within.any() else 0.0
    fast = np.where(within, np.maximum(moved - _FASTER * usual, 0.0), 0.0)
    path = np.append(fast, 0.0) + np.append(0.0, fast)
    share = number / slip.size
    if path.any():
        share = 0.5 * share + 0.5 * path / path.sum()
    return edges, _within(share, number / min(most, slip.size))


def _within(share: np.ndarray, largest: np.ndarray) -> np.ndarray:
    """Shares [pieces], none above its largest: the others have in proportion what is above it.

    Where the slip jumps, a piece of few rows would have more blocks than rows: most of them would
    be empty, and all other blocks longer than they need to be.
    """
    full = np.zeros(share.size, bool)
    while (more := (share > largest) & ~full).any():
        full |= more
        share = np.where(full, largest, share)
        left = max(1 - float(share[full].sum()), 0.0)
        share[~full] *= left / max(float(share[~full].sum()), 1e-300)
    return share


def _labels(runs: RunSet) -> tuple[str, ...]:
    """The conditions that are labels, which have no mean."""
    return (*runs.named, "mode")


def _of_one_label(runs: RunSet, begins: np.ndarray) -> np.ndarray:
    """Which rows, [rows], bool, have the labels of one row of their block."""
    number = np.diff(begins, append=runs.whole.slip.size)
    kept = np.ones(runs.whole.slip.size, bool)
    block = np.repeat(np.arange(begins.size), number)
    chosen = begins + np.arange(begins.size) % number
    for name in _labels(runs):
        if name in runs.whole.conditions:
            values = runs.whole.conditions[name]
            kept &= values == values[chosen][block]
    return kept
