"""Which rows of measured tables make up a run."""

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from adhesion_jax.data.reading import Measured

#: A new run begins where the step in time exceeds this multiple of the median step and _PAUSE
#: seconds.
_STEPS = 10.0
_PAUSE = 1.0

#: Points of a block, and how many blocks there shall be. With fewer, a test that flips the sign of
#: whole blocks cannot reach p = .001; beyond the most, longer blocks are worth more than further
#: ones, for they depend less on their neighbours.
_BLOCK_POINTS = 10
_FEWEST_BLOCKS = 16
_MOST_BLOCKS = 50


class Grouping(NamedTuple):
    """The run of every row, [rows], from 0 in the order in which the runs begin."""

    run: np.ndarray
    names: tuple[str, ...]
    blocks: bool = False  # contiguous blocks of one run take the place of runs


def group(files: Sequence[Measured]) -> Grouping:
    """The runs of all files: by the column run, else by gaps in time_s, else a file is a run.

    No run reaches over two files: a name that stands in several of them is named file:name.
    """
    labels = [_labels(file.table) for file in files]
    parts = [pd.factorize(label) for label in labels]
    in_files = Counter(str(name) for _, names in parts for name in names)
    runs: list[np.ndarray] = []
    all_names: list[str] = []
    for file, (codes, names) in zip(files, parts, strict=True):
        runs.append(codes + len(all_names))
        all_names += [f"{file.name}:{name}" if in_files[name] > 1 else name for name in names]
    return Grouping(np.concatenate(runs), tuple(all_names))


def in_blocks(grouping: Grouping) -> Grouping:
    """A single run cut into contiguous blocks of like length; several runs as they are.

    A block has at least 10 points, and fewer (down to 2) where there would be under 16 blocks.
    """
    points = grouping.run.size
    if len(grouping.names) > 1 or points < 4:
        return grouping
    wanted = max(points // _BLOCK_POINTS, min(_FEWEST_BLOCKS, points // 2))
    count = min(wanted, _MOST_BLOCKS)
    names = tuple(f"block {number}" for number in range(1, count + 1))
    return Grouping(np.arange(points) * count // points, names, blocks=True)


def places(run: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The rows of each run in their order, both [runs, points].

    In the first the last row of a run is repeated to the length of the longest run, in the second
    -1 stands there.
    """
    order = np.argsort(run, kind="stable")
    length = np.bincount(run)
    first = np.cumsum(length) - length
    step = np.arange(length.max())
    held = order[first[:, None] + np.minimum(step, length[:, None] - 1)]
    return held, np.where(step < length[:, None], held, -1)


def _labels(table: pd.DataFrame) -> np.ndarray:
    if "run" in table:
        return table["run"].to_numpy(object)
    if "time_s" not in table:
        return np.full(len(table), "1", dtype=object)
    steps = np.diff(table["time_s"])
    forward = steps[steps > 0]
    # Stamps may be coarser than the samples: a step of zero is no measure of the usual one.
    usual = float(np.median(forward)) if forward.size else 0.0
    gap = steps > max(_STEPS * usual, _PAUSE)
    return (1 + np.concatenate([[0], np.cumsum(gap)])).astype(str).astype(object)


def with_history(held: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The places of blocks of one run in time, each led in by the rows before it.

    As many as a block has places, the first row again where there are none; in `rows`, -1 stands
    for them: what acts with a memory needs them, and they count in no sum.
    """
    lead = rows.shape[1]
    before = np.maximum(held[:, :1] - np.arange(lead, 0, -1), 0)
    return np.hstack([before, held]), np.hstack([np.full_like(before, -1), rows])
