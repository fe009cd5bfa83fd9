"""Whole jobs as users start them: noise, identification, metrics and store, in a new process."""

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from adhesion_jax import runtime
from adhesion_jax.keeping import VARIABLE
from experiments.speed.turns import COLUMNS

#: The methods whose jobs are timed, each on the scenario `single`.
METHODS = ("ml-exact", "lm")

#: Numbers of runs: few, so that starting and compiling is most of it, and many.
FEW, MANY = 256, 1_048_576


class Job(NamedTuple):
    """A job, how many cores it has, and whether its programs are compiled before."""

    method: str
    runs: int
    cores: int
    warm: bool

    @property
    def name(self) -> str:
        state = "compiled before" if self.warm else "nothing compiled before"
        return f"{self.method}, {self.runs:,} runs, {self.cores} of the cores, {state}"


def jobs() -> list[Job]:
    """In order: the first job of a method has nothing compiled."""
    many = [1] if runtime.CORES == 1 else [1, runtime.CORES]
    return [
        job
        for method in METHODS
        for job in (
            Job(method, FEW, 1, False),
            Job(method, FEW, 1, True),
            *(Job(method, MANY, cores, True) for cores in many),
        )
    ]


def table(cores: Sequence[int | None], progress: Callable[[str], None]) -> pd.DataFrame:
    """A row for each job; the rate is per second by the clock, and so it depends on the load.

    `cores` are the numbers of those that a job may have, None where that cannot be chosen.
    """
    with tempfile.TemporaryDirectory() as folder:
        rows = _rows(Path(folder), cores, progress)
        return pd.DataFrame(rows).reindex(columns=[*COLUMNS, "size"])


def _rows(
    folder: Path, cores: Sequence[int | None], progress: Callable[[str], None]
) -> Iterator[dict[str, object]]:
    environment = {**os.environ, VARIABLE: str(folder / "cache")}
    for number, job in enumerate(jobs()):
        command = [
            *(sys.executable, "-m", "adhesion_jax", "montecarlo", "--scenario", "single"),
            *("--identifiers", job.method, "--runs", str(job.runs)),
            *("--out", str(folder / str(number))),
        ]
        spent, seconds, memory = _measured(command, environment, cores[: job.cores])
        progress(job.name)
        yield {
            "part": "whole job",
            "name": job.name,
            "unit": "identifications",
            "rate": job.runs / seconds,
            "memory_mb": memory,
            "remark": f"{seconds:.1f} s by the clock, {spent:.1f} CPU-seconds",
            "size": job.cores,
        }


def _measured(
    command: list[str], environment: dict[str, str], cores: Sequence[int | None]
) -> tuple[float, float, float]:
    """CPU-seconds, seconds, and the memory of the largest process of the job in MB."""
    chosen = ",".join(str(core) for core in cores if core is not None)
    own = [sys.executable, "-c", _CHILD, chosen, *command]
    began = time.perf_counter()
    done = subprocess.run(own, env=environment, capture_output=True, text=True, check=True)
    seconds = time.perf_counter() - began
    spent, memory = map(float, done.stdout.split())
    return spent, seconds, memory


#: A process of its own, whose children are those of one job alone.
_CHILD = """
import os, resource, subprocess, sys
if sys.argv[1]:
    os.sched_setaffinity(0, map(int, sys.argv[1].split(",")))
subprocess.run(sys.argv[2:], stdout=subprocess.DEVNULL, check=True)
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(used.ru_utime + used.ru_stime, used.ru_maxrss / 1024)
"""
