"""The cases of a traction system: each once without noise, and drawn, and many times with noise."""

import time
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd

from adhesion_jax import programs
from adhesion_jax.campaign.executor import mapped
from adhesion_jax.campaign.keys import noise_keys
from adhesion_jax.metrics import closed_loop
from adhesion_jax.metrics.closed_loop import FIGURES, Totals
from adhesion_jax.metrics.moments import KnownMoments
from adhesion_jax.runtime import CORES
from adhesion_jax.traction.loop import Loop, Timing, Trace, check, run, timing, trace
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.systems.base import Case, System, built

#: The number of runs of a tile is a multiple of this: with fewer runs the calls at each step take
#: longer than the work. No loop has a matrix product or a sum over runs, so that a run gives the
#: same bits whatever runs beside it.
_LEAST = 32

#: Largest number of runs of a tile: with more the states leave the cache.
_MOST = 512

#: Largest number of rows of a run that is drawn.
_ROWS = 3000

#: The name of the segment that is the whole run.
WHOLE = "all"

#: Values of the column noise.
QUIET, NOISY = "none", "yes"

#: The words for a figure that is 1 in a run, and 0 otherwise.
_STATUSES = {
    "stood": "the train never moves",
    "rolled_back": "the train rolls back",
    "ran_away": "slip runs away",
}

Figures = Mapping[str, np.ndarray]  # by name: [runs, segments, of which the last is the whole run]


class Judged(NamedTuple):
    """The results of the cases of a system."""

    metrics: pd.DataFrame  # a row a case, segment and noise
    traces: Sequence[Trace]  # of each case without noise: NumPy arrays [rows, ...]
    seconds: float  # CPU seconds of all processes together, without compilation
    compile_seconds: float  # wall-clock seconds, added up over all processes
    steps: int  # number of steps of the plant, in all runs


class Unit(NamedTuple):
    """Work of one process: cases of one form without noise, or some noisy runs of a case."""

    cases: tuple[int, ...]  # by their numbers
    loops: tuple[Loop, ...]
    grid: Timing
    seed: int
    scenario: str
    runs: range | None


class Plan(NamedTuple):
    """The units of work for the cases of a system, and the number of runs with noise of each."""

    cases: Sequence[Case]
    units: Sequence[Unit]
    runs: int


class _Result(NamedTuple):
    figures: Figures
    trace: Trace | None  # [cases, rows, ...]
    seconds: float
    compile_seconds: float


def planned(
    system: System, cases: Sequence[Case], plant: Plant, runs: int = 0, seed: int = 0
) -> Plan:
    """Every case once without noise, those of one form together, and some runs with noise.

    Raises InputError if a seeker and a controller do not go together, or a case has no grid of
    steps.
    """
    alike: dict[tuple[object, Timing], list[tuple[int, Loop]]] = defaultdict(list)
    noisy = []
    for number, case in enumerate(cases):
        loop = built(system, case, plant)
        check(loop)
        grid = timing(loop, system.step, system.control_period or system.step, system.duration)
        alike[_form(loop), grid].append((number, loop))
        for tile in _tiles(runs):
            disturbed = (built(system, case, plant, noisy=True),)
            noisy.append(Unit((number,), disturbed, grid, seed, case.scenario, tile))
    quiet = []
    for (_, grid), members in alike.items():
        numbers, loops = zip(*members, strict=True)
        quiet.append(Unit(numbers, loops, grid, seed, "", None))
    return Plan(cases, [*quiet, *noisy], runs)


def judge(plan: Plan, progress: Callable[[str], None], workers: int = CORES) -> Judged:
    """The figures of every case, without noise and over its runs with noise.

    `progress` is given the method of a unit of work whenever one is done.
    """
    traces: dict[int, Trace] = {}
    tally: dict[tuple[int, str], KnownMoments] = {}
    seconds = compile_seconds = 0.0
    steps = 0
    work = [(unit,) for unit in plan.units]
    with mapped(_judged, work, min(workers, len(work))) as results:
        for unit, result in zip(plan.units, results, strict=True):
            seconds += result.seconds
            compile_seconds += result.compile_seconds
            steps += len(next(iter(result.figures.values()))) * _steps(unit.grid)
            if unit.runs is None:
                for lane, case in enumerate(unit.cases):
                    tally[case, QUIET] = _moments(result.figures, slice(lane, lane + 1))
                    traces[case] = jax.tree.map(lambda x, i=lane: x[i], result.trace)
            else:
                part = _moments(result.figures, slice(0, plan.runs - unit.runs.start))
                key = unit.cases[0], NOISY
                tally[key] = tally[key].plus(part) if key in tally else part
            progress(plan.cases[unit.cases[0]].method)
    metrics = pd.concat(
        [
            _rows(case, noise, tally[number, noise])
            for number, case in enumerate(plan.cases)
            for noise in (QUIET, NOISY)
            if (number, noise) in tally
        ],
        ignore_index=True,
    )
    in_order = [traces[number] for number in range(len(plan.cases))]
    return Judged(metrics, in_order, seconds, compile_seconds, steps)


def _tiles(runs: int) -> list[range]:
    """Tiles of equal size, of which the last may go beyond the runs."""
    size = min(-(-runs // _LEAST) * _LEAST, _MOST)
    return [range(first, first + size) for first in range(0, runs, size or 1)]


def _steps(grid: Timing) -> int:
    return grid.samples * grid.sample * grid.control


def _judged(unit: Unit) -> _Result:
    drawn = unit.runs is None
    numbers = range(len(unit.loops)) if unit.runs is None else unit.runs
    keys = noise_keys(unit.seed, unit.scenario, jnp.asarray(numbers))
    stacked = jax.tree.map(lambda *x: jnp.stack([*map(jnp.asarray, x)]), *unit.loops)
    began = time.perf_counter()
    form = jax.tree.structure((stacked, keys))
    compiled = _compiled(form, _kinds((stacked, keys)), unit.grid, drawn)
    compile_seconds = time.perf_counter() - began
    began = time.process_time()
    found = jax.block_until_ready(compiled(jax.tree.leaves((stacked, keys))))
    seconds = time.process_time() - began
    figures, rows = jax.tree.map(np.asarray, found)
    return _Result(figures, rows, seconds, compile_seconds)


def _form(loop: Loop) -> object:
    """The key of a loop: loops of equal keys are run by one program."""
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
    """Figures of a stack of loops under their keys, and the rows of what is drawn.

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

    # What is drawn runs once, and takes longer to compile than to run: without the fusion emitters
    # it takes half the time to compile.
    compiler = {"xla_cpu_use_fusion_emitters": False} if drawn else {}
    name = ("traction", form, str(kinds), grid, drawn)
    return programs.program(name, unit, [*kinds], compiler)


def _every(grid: Timing) -> int:
    """Number of samples from one drawn row to the next: the smallest that divides the run."""
    least = max(-(-grid.samples // _ROWS), 1)
    return next(n for n in range(least, grid.samples + 1) if grid.samples % n == 0)


def _figures(totals: Totals, grid: Timing) -> dict[str, jax.Array]:
    """The figures of each segment and, last, of the whole run."""
    parts = (closed_loop.by_segment(totals), closed_loop.whole(totals))
    found = [closed_loop.figures(part, grid.sample_period) for part in parts]
    return {name: jnp.concatenate([1.0 * part[name] for part in found]) for name in FIGURES}


def _moments(figures: Figures, runs: slice) -> KnownMoments:
    return KnownMoments.of({name: figure[runs] for name, figure in figures.items()})


def _rows(case: Case, noise: str, moments: KnownMoments) -> pd.DataFrame:
    """A row for each segment and one for the whole run: metrics and their standard errors."""
    columns: dict[str, Any] = {
        "scenario": case.scenario,
        "method": case.method,
        "segment": [*case.segments, WHOLE],
        "noise": noise,
    }
    for name in FIGURES:
        columns[name] = moments.mean(name)
        columns[f"{name}_se"] = moments.standard_error(name)
    places = range(len(columns["segment"]))
    columns["status"] = [_status(moments, place) for place in places]
    return pd.DataFrame(columns)


def _status(moments: KnownMoments, segment: int) -> str:
    """The status of a segment in words, with the number of runs if there are several."""
    if not moments.known["utilisation"][segment]:
        return "not reached"
    counts = {words: int(moments.total[name][segment]) for name, words in _STATUSES.items()}
    told = {words: count for words, count in counts.items() if count}
    if not told:
        return "regular"
    if moments.runs == 1:
        return ", ".join(told)
    return ", ".join(f"{words} in {count} of {moments.runs} runs" for words, count in told.items())
