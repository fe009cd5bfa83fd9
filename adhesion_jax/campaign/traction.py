"""The cases of a traction system: each once without noise, and drawn, and many times with noise.

The runs are divided into shards. The first shards have the cases without noise, those of one form
together; in each of those that follow are some noisy runs of one case, the cases by turns.
"""

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
import pandas as pd
import pyarrow as pa

from adhesion_jax.campaign.identity import own_files, settings_of, surroundings
from adhesion_jax.campaign.loops import computed, form_of, steps_of
from adhesion_jax.campaign.notes import Tell
from adhesion_jax.campaign.pool import Processes
from adhesion_jax.campaign.rows import segment_rows
from adhesion_jax.campaign.store import Arrays, Content
from adhesion_jax.metrics.closed_loop import FIGURES
from adhesion_jax.metrics.moments import KnownMoments, plus
from adhesion_jax.runtime import CORES, silent
from adhesion_jax.traction.loop import Loop, Timing, Trace, check, first_row, timing
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.systems.base import Case, System, built

#: The number of runs that a program computes side by side is a multiple of this: with fewer the
#: calls at each step take longer than the work. No loop has a matrix product or a sum over runs, so
#: that a run gives the same bits whatever runs beside it.
_LEAST = 32

#: Number of runs of a shard with noise: with more the states leave the cache.
_SHARD = 256

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

#: The leaves of the traces of a shard are stored under this and their number.
_TRACE = "trace "

#: The fields of the moments that are stored.
_SUMS = ("known", "total", "total_square")


class Judged(NamedTuple):
    """The results of the cases of a system."""

    metrics: pd.DataFrame  # a row a case, segment and noise
    traces: Sequence[Trace]  # of each case without noise: NumPy arrays [rows, ...]
    seconds: float  # CPU seconds of all processes together, without compilation
    compile_seconds: float  # wall-clock seconds, added up over all processes
    steps: int  # number of steps of the plant, in all runs


class Named(NamedTuple):
    """What the rows of a case are called."""

    scenario: str
    method: str
    segments: Sequence[str]


class Alike(NamedTuple):
    """Cases of one form, which one program runs side by side, without noise."""

    cases: tuple[int, ...]  # by their numbers
    loops: tuple[Loop, ...]
    grid: Timing


class Job(NamedTuple):
    """The cases of a system on a plant, and the number of runs of each with noise."""

    name: str
    asked: Mapping[str, str]  # the options of the command that tell what runs
    cases: tuple[Named, ...]
    quiet: tuple[Alike, ...]
    noisy: tuple[Loop, ...]  # of each case
    grids: tuple[Timing, ...]  # of each case
    runs: int
    seed: int

    @property
    def shards(self) -> int:
        return len(self.quiet) + -(-self.runs // _SHARD) * len(self.cases)

    def runs_of(self, shard: int) -> int:
        if shard < len(self.quiet):
            return len(self.quiet[shard].cases)
        return min(_SHARD, self.runs - self.noisy_runs(shard).start)

    def cases_of(self, shard: int) -> tuple[int, ...]:
        """The numbers of the cases that run in a shard."""
        if shard < len(self.quiet):
            return self.quiet[shard].cases
        return ((shard - len(self.quiet)) % len(self.cases),)

    def noisy_runs(self, shard: int) -> range:
        """The numbers of the runs that are computed in a shard with noise.

        The program of all of them has the same number of runs, so that the last ones may be beyond
        those asked for.
        """
        first = (shard - len(self.quiet)) // len(self.cases) * _SHARD
        return range(first, first + min(-(-self.runs // _LEAST) * _LEAST, _SHARD))

    @property
    def record(self) -> Mapping[str, Any]:
        depends = {
            **self.asked,
            "--seed": str(self.seed),
            "settings of the system": settings_of((self.quiet, self.noisy, self.grids)),
            **surroundings(),
            **own_files(),
        }
        return {
            "cases": [case._asdict() for case in self.cases],
            "in shards": [self.cases_of(number) for number in range(len(self.quiet))],
            "depends on": depends,
        }


def job_of(
    name: str,
    system: System,
    cases: Sequence[Case],
    plant: Plant,
    runs: int = 0,
    seed: int = 0,
    asked: Mapping[str, str] | None = None,
) -> Job:
    """Every case once without noise, those of one form together, and some runs with noise.

    Raises InputError if a seeker and a controller do not go together, or a case has no grid of
    steps.
    """
    alike: dict[tuple[object, Timing], list[tuple[int, Loop]]] = defaultdict(list)
    noisy, grids = [], []
    for number, case in enumerate(cases):
        loop = built(system, case, plant)
        check(loop)
        grid = timing(loop, system.step, system.control_period or system.step, system.duration)
        alike[form_of(loop), grid].append((number, loop))
        noisy.append(built(system, case, plant, noisy=True))
        grids.append(grid)
    quiet = []
    for (_, grid), members in alike.items():
        numbers, loops = zip(*members, strict=True)
        quiet.append(Alike(numbers, loops, grid))
    named = tuple(Named(case.scenario, case.method, tuple(case.segments)) for case in cases)
    return Job(name, asked or {}, named, tuple(quiet), tuple(noisy), tuple(grids), runs, seed)


def judge(job: Job, workers: int = CORES) -> Judged:
    """The figures of every case, without noise and over its runs with noise, in memory."""
    work = [(job, number) for number in range(job.shards)]
    with Processes(workers).mapped(content, work) as results:
        return judged(job, (found.arrays for found in results))


def content(job: Job, number: int, tell: Tell = silent) -> Content:
    """What is stored of a shard: sums of the figures, and the figures of every run."""
    cases = job.cases_of(number)
    tell(0, job.cases[cases[0]].method)
    if number < len(job.quiet):
        _, loops, grid = job.quiet[number]
        found = computed(loops, grid, job.seed, "", range(len(loops)), drawn=True)
        parts = [
            {name: figure[lane : lane + 1] for name, figure in found.figures.items()}
            for lane in range(len(loops))
        ]
        noise, first = QUIET, 0
    else:
        (case,), numbers = cases, job.noisy_runs(number)
        scenario, grid = job.cases[case].scenario, job.grids[case]
        found = computed((job.noisy[case],), grid, job.seed, scenario, numbers, drawn=False)
        parts = [{name: figure[: job.runs_of(number)] for name, figure in found.figures.items()}]
        noise, first = NOISY, numbers.start
    moments = [KnownMoments.of(figures) for figures in parts]
    sums = {
        kind: np.stack(
            [np.stack([getattr(one, kind)[name] for name in FIGURES]) for one in moments]
        )
        for kind in _SUMS
    }
    arrays = {
        **{_TRACE + str(place): leaf for place, leaf in enumerate(jax.tree.leaves(found.trace))},
        **sums,
        "cases": np.array(cases),
        "noisy": np.array(noise == NOISY),
        "summed runs": np.array(moments[0].runs),
        "steps": np.array(found.runs * steps_of(grid)),
        "seconds": np.array(found.seconds),
        "compile_seconds": np.array(found.compile_seconds),
    }
    runs = {"run": np.arange(first, first + moments[0].runs)}
    rows = [
        segment_rows(
            {"scenario": case.scenario, "method": case.method, "noise": noise},
            runs,
            [*case.segments, WHOLE],
            {name: figures[name] for name in FIGURES},
        )
        for case, figures in zip((job.cases[n] for n in cases), parts, strict=True)
    ]
    return Content(arrays, pa.concat_tables(rows).unify_dictionaries())


class Tally(NamedTuple):
    """What some shards add up to."""

    moments: Mapping[tuple[int, str], KnownMoments]  # by number of the case, and noise
    traces: Mapping[int, Sequence[np.ndarray]]  # the leaves of each case
    seconds: float
    compile_seconds: float
    steps: int


def added(parts: Iterable[Arrays]) -> Tally:
    """What shards add up to, in the order in which they are given."""
    tally: dict[tuple[int, str], KnownMoments] = {}
    traces: dict[int, list[np.ndarray]] = {}
    seconds = compile_seconds = 0.0
    steps = 0
    for part in parts:
        noise = NOISY if part["noisy"] else QUIET
        leaves = [part[f"{_TRACE}{n}"] for n in range(sum(key.startswith(_TRACE) for key in part))]
        for lane, case in enumerate(part["cases"].tolist()):
            sums = [dict(zip(FIGURES, part[kind][lane], strict=True)) for kind in _SUMS]
            moments = KnownMoments(int(part["summed runs"]), *sums)
            key = case, noise
            tally[key] = plus(tally[key], moments) if key in tally else moments
            if leaves:
                traces[case] = [leaf[lane] for leaf in leaves]
        seconds += float(part["seconds"])
        compile_seconds += float(part["compile_seconds"])
        steps += int(part["steps"])
    return Tally(tally, traces, seconds, compile_seconds, steps)


def judged(job: Job, parts: Iterable[Arrays]) -> Judged:
    """The results of a job from what is stored of all its shards."""
    tally = added(parts)
    forms = {
        case: jax.tree.structure(jax.eval_shape(lambda of=alike: first_row(of.loops[0], of.grid)))
        for alike in job.quiet
        for case in alike.cases
    }
    return Judged(
        metrics_of(job.cases, tally),
        [jax.tree.unflatten(forms[case], tally.traces[case]) for case in range(len(job.cases))],
        tally.seconds,
        tally.compile_seconds,
        tally.steps,
    )


def metrics_of(cases: Sequence[Named], tally: Tally) -> pd.DataFrame:
    """A row for each case, segment and noise of which there are runs."""
    return pd.concat(
        [
            _metrics(case, noise, tally.moments[number, noise])
            for number, case in enumerate(cases)
            for noise in (QUIET, NOISY)
            if (number, noise) in tally.moments
        ],
        ignore_index=True,
    )


def _metrics(case: Named, noise: str, moments: KnownMoments) -> pd.DataFrame:
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
