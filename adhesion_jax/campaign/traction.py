"""The cases of a traction system: each once without noise, and drawn, and many times with noise.

The runs are divided into shards. The first shards have the cases without noise, those of one form
together; in each of those that follow are some noisy runs of one case, the cases by turns.
"""

import operator
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
import pandas as pd
import pyarrow as pa

from adhesion_jax.campaign.identity import settings_of
from adhesion_jax.campaign.loops import computed, form_of
from adhesion_jax.campaign.pool import Processes
from adhesion_jax.campaign.rows import segment_rows
from adhesion_jax.campaign.store import Arrays, Content, Tell
from adhesion_jax.metrics.closed_loop import FIGURES
from adhesion_jax.metrics.moments import KnownMoments
from adhesion_jax.runtime import CORES, silent
from adhesion_jax.traction.loop import Loop, Timing, Trace, check, first_row, timing
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.systems.base import Case, System, built

#: The number of runs that a program computes side by side is a multiple of this: with fewer the
#: calls at each step take longer than the work. No loop has a matrix product or a sum over runs, so
#: that a run gives the same bits whatever runs beside it: but for sums over several axles, whose
#: last bit may depend on how many runs a program has.
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

#: The words for a run that reaches a segment and whose figures there are not finite.
FAILED = "the computation fails"

#: The leaves of the traces of a shard are stored under this and their number.
_TRACE = "trace "

#: The fields of the moments that are stored.
_SUMS = ("known", "total", "total_square")


class Judged(NamedTuple):
    """The results of the cases of a system, or of those of its runs that there are."""

    metrics: pd.DataFrame  # a row a case, segment and noise of which there are runs
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
    """Cases that one program runs side by side: of one form without noise, or one with it."""

    cases: tuple[int, ...]  # by their numbers
    loops: tuple[Loop, ...]
    grid: Timing


class Job(NamedTuple):
    """The cases of a system on a plant, and the number of runs of each with noise."""

    name: str
    asked: Mapping[str, str]  # the options of the command that tell what runs
    cases: tuple[Named, ...]
    quiet: tuple[Alike, ...]
    noisy: tuple[Alike, ...]  # of each case
    runs: int
    seed: int

    @property
    def shards(self) -> int:
        return len(self.quiet) + -(-self.runs // _SHARD) * len(self.cases)

    def runs_of(self, shard: int) -> int:
        if shard < len(self.quiet):
            return len(self.quiet[shard].cases)
        return min(_SHARD, self.runs - self.noisy_runs(shard).start)

    def in_shard(self, shard: int) -> Alike:
        """What runs in a shard."""
        if shard < len(self.quiet):
            return self.quiet[shard]
        return self.noisy[(shard - len(self.quiet)) % len(self.cases)]

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
            "settings of the system": settings_of((self.quiet, self.noisy)),
        }
        return {
            "cases": [case._asdict() for case in self.cases],
            "in shards": [alike.cases for alike in self.quiet],
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
    noisy = []
    for number, case in enumerate(cases):
        loop = built(system, case, plant)
        check(loop)
        grid = timing(loop, system.step, system.control_period or system.step, system.duration)
        alike[form_of(loop), grid].append((number, loop))
        noisy.append(Alike((number,), (built(system, case, plant, noisy=True),), grid))
    quiet = [
        Alike(numbers, loops, grid)
        for (_, grid), members in alike.items()
        for numbers, loops in [zip(*members, strict=True)]
    ]
    named = tuple(Named(case.scenario, case.method, tuple(case.segments)) for case in cases)
    return Job(name, asked or {}, named, tuple(quiet), tuple(noisy), runs, seed)


def judge(job: Job, workers: int = CORES) -> Judged:
    """The figures of every case, without noise and over its runs with noise, in memory."""
    work = [(job, number) for number in range(job.shards)]
    with Processes(workers).mapped(content, work) as results:
        return judged(job, (found.arrays for found in results))


def content(job: Job, number: int, tell: Tell = silent) -> Content:
    """What is stored of a shard: sums of the figures, and the figures of every run."""
    numbers, loops, grid = job.in_shard(number)
    cases, runs = [job.cases[case] for case in numbers], job.runs_of(number)
    tell(0, cases[0].method)
    if number < len(job.quiet):
        found = computed(loops, grid, job.seed, "", range(runs), drawn=True)
        noise, first, each = QUIET, 0, 1
    else:
        keys = job.noisy_runs(number)
        found = computed(loops, grid, job.seed, cases[0].scenario, keys, drawn=False)
        noise, first, each = NOISY, keys.start, runs
    parts = [
        {name: figure[lane : lane + each] for name, figure in found.figures.items()}
        for lane in range(len(cases))
    ]
    moments = [KnownMoments.of(figures) for figures in parts]
    arrays = {
        **{_TRACE + str(place): leaf for place, leaf in enumerate(jax.tree.leaves(found.course))},
        **{
            kind: np.array([[getattr(one, kind)[name] for name in FIGURES] for one in moments])
            for kind in _SUMS
        },
        "cases": np.array(numbers),
        "noisy": np.array(noise == NOISY),
        "summed runs": np.array(each),
        **found.took(),
    }
    rows = [
        segment_rows(
            {"scenario": case.scenario, "method": case.method, "noise": noise},
            {"run": np.arange(first, first + each)},
            [*case.segments, WHOLE],
            {name: figures[name] for name in FIGURES},
        )
        for case, figures in zip(cases, parts, strict=True)
    ]
    return Content(arrays, pa.concat_tables(rows).unify_dictionaries())


def added(cases: Sequence[Named], parts: Iterable[Arrays]) -> Judged:
    """What shards add up to, in the order in which they are given; of traces there are leaves."""
    moments: dict[tuple[int, str], KnownMoments] = {}
    traces: dict[int, Any] = {}
    took = Counter[str]()
    for part in parts:
        noise = NOISY if part["noisy"] else QUIET
        leaves = [part[f"{_TRACE}{n}"] for n in range(sum(key.startswith(_TRACE) for key in part))]
        for lane, case in enumerate(part["cases"].tolist()):
            sums = [dict(zip(FIGURES, part[kind][lane], strict=True)) for kind in _SUMS]
            own = KnownMoments(int(part["summed runs"]), *sums)
            key = case, noise
            known = moments.get(key)
            moments[key] = own if known is None else jax.tree.map(operator.add, known, own)
            if leaves:
                traces[case] = [leaf[lane] for leaf in leaves]
        took.update({name: part[name].item() for name in ("seconds", "compile_seconds", "steps")})
    metrics = [
        _metrics(case, noise, moments[number, noise])
        for number, case in enumerate(cases)
        for noise in (QUIET, NOISY)
        if (number, noise) in moments
    ]
    drawn = [traces[case] for case in sorted(traces)]
    return Judged(pd.concat(metrics, ignore_index=True), drawn, **took)


def judged(job: Job, parts: Iterable[Arrays]) -> Judged:
    """The results of a job from what is stored of all its shards."""
    found = added(job.cases, parts)
    forms = {
        case: jax.tree.structure(jax.eval_shape(lambda of=alike: first_row(of.loops[0], of.grid)))
        for alike in job.quiet
        for case in alike.cases
    }
    drawn = enumerate(found.traces)
    return found._replace(traces=[jax.tree.unflatten(forms[case], own) for case, own in drawn])


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
    # Whether the train stood is known of every run that reached the segment.
    reached = moments.known["stood"][segment]
    if not reached:
        return "not reached"
    failed = reached - moments.known["utilisation"][segment]
    totals = {words: moments.total[name][segment] for name, words in _STATUSES.items()}
    counts = {words: int(count) for words, count in {FAILED: failed, **totals}.items()}
    told = {words: count for words, count in counts.items() if count}
    if not told:
        return "regular"
    if moments.runs == 1:
        return ", ".join(told)
    return ", ".join(f"{words} in {count} of {moments.runs} runs" for words, count in told.items())
