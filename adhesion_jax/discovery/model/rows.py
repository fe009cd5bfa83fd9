"""The prediction of a law at every row of measured runs, a bounded number of rows at a time."""

from collections.abc import Iterable, Iterator, Mapping

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.data.runs import RunSet, places
from adhesion_jax.effects.conditions import Calendar, completed_runs
from adhesion_jax.effects.law import CorrectedLaw
from adhesion_jax.programs import kept

#: Number of cells of one column that are computed at a time.
_CELLS = 2**17

#: Fewest points to which runs are padded; beyond it the powers of two, so that programs are few.
_FEWEST_POINTS = 256

#: By column, the smallest and the largest value of the rows.
Ranges = Mapping[str, tuple[float, float]]


def _pieces(runs: RunSet) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """All rows, a bounded number at a time: their places side by side, [runs, points].

    Beside these, whether a row counts or only leads others in. A run that is longer is taken in
    stretches. A stretch of a run in time, or a block of one run, is led in by as many rows as it
    has, for what acts with a memory.
    """
    lengths = runs.lengths
    if lengths.size * lengths.max() <= _CELLS:
        yield runs.layout
        return
    led = "time_s" in runs.whole.conditions
    begin, start, stop = [], [], []
    for first, length in zip(runs.starts, lengths, strict=True):
        earliest = 0 if runs.blocks else first
        for at in range(first, first + length, _CELLS):
            end = min(at + _CELLS, first + length)
            begin.append(max(at - (end - at), earliest) if led else at)
            start.append(at)
            stop.append(end)
    begins, starts, stops = map(np.array, (begin, start, stop))
    size = np.maximum(_FEWEST_POINTS, 2 ** np.ceil(np.log2(stops - begins)).astype(int))
    for points in np.unique(size):
        some = np.flatnonzero(size == points)
        count = min(max(_CELLS // points, 1), some.size)
        for at in range(0, some.size, count):
            # The last group is filled up with runs in which nothing counts.
            group = np.resize(some[at : at + count], count)
            there = np.arange(count) < some.size - at
            held, _ = places(begins[group], stops[group] - begins[group], int(points))
            inside = (held >= starts[group][:, None]) & there[:, None]
            inside[:, 1:] &= np.diff(held, axis=1) > 0
            yield held, inside


def predicted(law: CorrectedLaw, runs: RunSet) -> np.ndarray:
    """Adhesion of every row, [rows]."""
    found = np.empty(runs.whole.slip.size)
    for held, inside in _pieces(runs):
        values = np.asarray(_of_runs(law, *_rows_of(runs, held)))
        found[held[inside]] = values[inside]
    return found


def columns_of(names: Iterable[str], calendar: Calendar, runs: RunSet) -> dict[str, np.ndarray]:
    """Conditions of every row, [rows], measured or computed from what is measured."""
    found = {name: np.empty(runs.whole.slip.size) for name in names}
    for held, inside in _pieces(runs):
        whole = completed_runs(*_rows_of(runs, held), calendar)
        for name, values in found.items():
            values[held[inside]] = np.asarray(whole[name])[inside]
    return found


@kept()
def _of_runs(
    law: CorrectedLaw,
    slip: Float[Array, "runs points"],
    conditions: Mapping[str, Float[Array, "runs points"]],
) -> Float[Array, "runs points"]:
    return jax.vmap(law)(slip, conditions)


def _rows_of(runs: RunSet, held: np.ndarray) -> tuple[Array, Mapping[str, Array]]:
    return jnp.asarray(runs.whole.slip[held]), runs.conditions_at(held)
