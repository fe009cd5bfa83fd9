"""The cases of a traction system: each once without noise, and drawn, and many times with noise."""

import pickle
import time
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd

from adhesion_jax.campaign.executor import mapped
from adhesion_jax.campaign.keys import noise_keys
from adhesion_jax.metrics import closed_loop
from adhesion_jax.metrics.closed_loop import FIGURES, Totals
from adhesion_jax.metrics.moments import Moments
from adhesion_jax.runtime import CORES, shared_program
from adhesion_jax.traction.loop import Loop, Timing, Trace, run, trace
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.systems.base import Case, System, built

#: A tile has a multiple of so many runs, and at most so many: few lose time by the calls of each
#: step, more by leaving the cache. There is no matrix product or sum over runs in a loop, so that
#: the result of a run does not depend on the runs beside it, to the bit.
_LEAST, _MOST = 32, 512

#: A run that is drawn has at most this many rows.
_ROWS = 3000

#: The name of the segment that is the whole run.
WHOLE = "all"

#: Values of the column noise.
QUIET, NOISY = "none", "yes"

#: What is said of a segment by the share of its runs in a figure.
_STATUSES = {
    "stood": "the train never moves",
    "rolled_back": "the train rolls back",
    "ran_away": "slip runs away",
}

Figures = Mapping[str, np.ndarray]  # by name: [runs, segments, of which the last is the whole run]


class Judged(NamedTuple):
    """What became of the cases of a system."""

    metrics: pd.DataFrame  # a row a case, segment and noise
    traces: Sequence[Trace]  # of each case without noise: NumPy arrays [rows, ...]
    seconds: float  # of the processor, all processes together, without compilation
    compile_seconds: float  # as the clock has it, of all processes added up
    steps: int  # of the plant, in all runs


class _Unit(NamedTuple):
    """Work of one process: cases of one form without noise, or some noisy runs of a case."""

    loops: tuple[Loop, ...]
    grid: Timing
    seed: int
    scenario: str
    runs: range | None


class _Result(NamedTuple):
    figures: Figures
    trace: Trace | None  # [cases, rows, ...]
    seconds: float
    compile_seconds: float


def judge(
    system: System,
    cases: Sequence[Case],
    plant: Plant,
    grids: Sequence[Timing],
    runs: int,
    seed: int,
    progress: Callable[[str], None],
    workers: int = CORES,
) -> Judged:
    """The figures of every case on its grid, without noise and over some runs with noise.

    `progress` is given the method of a unit of work whenever one is done.
    """
    work = _work(system, cases, plant, grids, runs, seed)
    traces: dict[int, Trace] = {}
    tally: dict[tuple[int, str], Moments] = {}
    seconds = compile_seconds = 0.0
    steps = 0
    with mapped(_judged, [unit for unit, _ in work], min(workers, len(work))) as results:
        for (unit, members), result in zip(work, results, strict=True):
            seconds += result.seconds
            compile_seconds += result.compile_seconds
            steps += len(next(iter(result.figures.values()))) * _steps(unit.grid)
            if unit.runs is None:
                for lane, case in enumerate(members):
                    tally[case, QUIET] = _moments(result.figures, slice(lane, lane + 1))
                    traces[case] = jax.tree.map(lambda x, i=lane: x[i], result.trace)
            else:
                part = _moments(result.figures, slice(0, runs - unit.runs.start))
                key = members[0], NOISY
                tally[key] = tally[key].plus(part) if key in tally else part
            progress(cases[members[0]].method)
    metrics = pd.concat(
        [
            _rows(case, noise, tally[number, noise])
            for number, case in enumerate(cases)
            for noise in (QUIET, NOISY)
            if (number, noise) in tally
        ],
        ignore_index=True,
    )
    in_order = [traces[number] for number in range(len(cases))]
    return Judged(metrics, in_order, seconds, compile_seconds, steps)


def units(
    system: System, cases: Sequence[Case], plant: Plant, grids: Sequence[Timing], runs: int
) -> int:
    """How often `judge` reports progress."""
    return len(_work(system, cases, plant, grids, runs, 0))


def _work(
    system: System,
    cases: Sequence[Case],
    plant: Plant,
    grids: Sequence[Timing],
    runs: int,
    seed: int,
) -> list[tuple[_Unit, tuple[int, ...]]]:
    """The units, and the numbers of the cases that each is about."""
    alike: dict[object, list[int]] = defaultdict(list)
    for number, case in enumerate(cases):
        alike[_form(built(system, case, plant)), grids[number]].append(number)
    found = []
    for members in alike.values():
        loops = tuple(built(system, cases[number], plant) for number in members)
        found.append((_Unit(loops, grids[members[0]], seed, "", None), tuple(members)))
    for number, case in enumerate(cases):
        loop = built(system, case, plant, noisy=True)
        for tile in _tiles(runs):
            found.append((_Unit((loop,), grids[number], seed, case.scenario, tile), (number,)))
    return found


def _tiles(runs: int) -> list[range]:
    """Equal ones, of which the last may go beyond the runs."""
    size = min(-(-runs // _LEAST) * _LEAST, _MOST)
    return [range(first, first + size) for first in range(0, runs, size or 1)]


def _steps(grid: Timing) -> int:
    return grid.samples * grid.sample * grid.control


def _judged(
    loops: tuple[Loop, ...], grid: Timing, seed: int, scenario: str, runs: range | None
) -> _Result:
    drawn = runs is None
    keys = noise_keys(seed, scenario, jnp.asarray(range(len(loops)) if runs is None else runs))
    stacked = jax.tree.map(lambda *x: jnp.stack([*map(jnp.asarray, x)]), *loops)
    began = time.perf_counter()
    compiled = _compiled(jax.tree.structure((stacked, keys)), _kinds((stacked, keys)), grid, drawn)
    compile_seconds = time.perf_counter() - began
    began = time.process_time()
    found = jax.block_until_ready(compiled(jax.tree.leaves((stacked, keys))))
    seconds = time.process_time() - began
    figures, rows = jax.tree.map(np.asarray, found)
    return _Result(figures, rows, seconds, compile_seconds)


def _form(loop: Loop) -> object:
    """What loops have in common that one program can run."""
    return jax.tree.structure(loop), tuple(jnp.shape(leaf) for leaf in jax.tree.leaves(loop))


def _kinds(tree: Any) -> tuple[jax.ShapeDtypeStruct, ...]:
    return tuple(jax.ShapeDtypeStruct(leaf.shape, leaf.dtype) for leaf in jax.tree.leaves(tree))


@cache
def _compiled(
    form: jax.tree_util.PyTreeDef,
    kinds: tuple[jax.ShapeDtypeStruct, ...],
    grid: Timing,
    drawn: bool,
) -> Callable[[list[Any]], tuple[dict[str, jax.Array], Trace | None]]:
    """Of a stack of loops and their keys: the figures, and the rows of what is drawn.

    One loop with many keys stands for as many runs of it.
    """

    def of_drawn(loop: Loop, key: jax.Array) -> tuple[dict[str, jax.Array], Trace]:
        totals, rows = trace(loop, grid, key, _every(grid))
        return _figures(totals, grid), rows

    def of_run(loop: Loop, key: jax.Array) -> dict[str, jax.Array]:
        return _figures(run(loop, grid, key), grid)

    def unit(leaves: list[Any]) -> tuple[dict[str, jax.Array], Trace | None]:
        loops, keys = jax.tree.unflatten(form, leaves)
        if drawn:
            return jax.vmap(of_drawn)(loops, keys)
        loop = jax.tree.map(lambda x: x[0], loops)
        return jax.vmap(of_run, (None, 0))(loop, keys), None

    def make() -> jax.stages.Compiled:
        return jax.jit(unit).lower([*kinds]).compile()

    return shared_program(pickle.dumps((form, str(kinds), grid, drawn)), make)


def _every(grid: Timing) -> int:
    """Samples from one row that is drawn to the next: the least that divides the run."""
    least = max(-(-grid.samples // _ROWS), 1)
    return next(n for n in range(least, grid.samples + 1) if grid.samples % n == 0)


def _figures(totals: Totals, grid: Timing) -> dict[str, jax.Array]:
    """Of each segment, and last of the whole run."""
    parts = (closed_loop.by_segment(totals), closed_loop.whole(totals))
    found = [closed_loop.figures(part, grid.sample_period) for part in parts]
    return {name: jnp.concatenate([1.0 * part[name] for part in found]) for name in FIGURES}


def _moments(figures: Figures, runs: slice) -> Moments:
    """Of the figures, and of whether each is a number: one that is none in a run is left out."""
    taken = {name: figure[runs] for name, figure in figures.items()}
    known = {_known(name): 1.0 * np.isfinite(x) for name, x in taken.items()}
    return Moments.of({name: np.where(np.isfinite(x), x, 0.0) for name, x in taken.items()} | known)


def _known(name: str) -> str:
    return f"{name} is known"


def _rows(case: Case, noise: str, moments: Moments) -> pd.DataFrame:
    """One row a segment, and one for the whole run: each metric and its standard error."""
    columns: dict[str, Any] = {
        "scenario": case.scenario,
        "method": case.method,
        "segment": [*case.segments, WHOLE],
        "noise": noise,
    }
    for name in FIGURES:
        count = moments.total[_known(name)]
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = moments.total[name] / count
            variance = np.maximum(moments.total_square[name] / count - mean**2, 0.0)
            error = np.where(count > 1, np.sqrt(variance / (count - 1)), np.nan)
        columns[name], columns[f"{name}_se"] = mean, error
    shares = [np.nan_to_num(columns[name]) for name in _STATUSES]
    seen = moments.total[_known("utilisation")] > 0
    columns["status"] = [
        _status(dict(zip(_STATUSES.values(), share, strict=True)), moments.runs)
        if there
        else "not reached"
        for there, *share in zip(seen, *shares, strict=True)
    ]
    return pd.DataFrame(columns)


def _status(shares: Mapping[str, float], runs: int) -> str:
    """In words, with the number of runs where there are several."""
    told = {words: round(share * runs) for words, share in shares.items() if share > 0}
    if not told:
        return "regular"
    if runs == 1:
        return ", ".join(told)
    return ", ".join(f"{words} in {count} of {runs} runs" for words, count in told.items())
