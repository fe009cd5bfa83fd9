"""A study as a job in shards: one set each, of which a row is left."""

import time
from collections.abc import Callable, Mapping
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa

from adhesion_jax.campaign.identity import own_files, surroundings
from adhesion_jax.campaign.monte_carlo import frame_of
from adhesion_jax.campaign.store import Content, Tell, read, rows_of
from adhesion_jax.discovery.types import Findings
from adhesion_jax.library.discover import discover
from adhesion_jax.runtime import silent
from experiments.campaigns.simulator import SimulatedSet
from experiments.discovery_study.judging import judged
from experiments.discovery_study.tasks import Task, make_set

#: What is studied: training table, test table or none, and seed to findings.
Discover = Callable[[pd.DataFrame, pd.DataFrame | None, int], Findings]


def discovered(train: pd.DataFrame, test: pd.DataFrame | None, seed: int) -> Findings:
    """The findings that a user gets from these tables; reading them is included."""
    return discover(train, test, seed=seed).findings


class Study(NamedTuple):
    """The sets of a study, and what is studied on them."""

    tasks: tuple[Task, ...]
    discover: Discover
    asked: Mapping[str, int]  # the options of the command that tell what is made

    @property
    def name(self) -> str:
        return "study"

    @property
    def runs(self) -> int:
        return len(self.tasks)

    @property
    def shards(self) -> int:
        return len(self.tasks)

    def runs_of(self, shard: int) -> int:
        return 1

    @property
    def record(self) -> Mapping[str, Any]:
        own = sorted(Path(__file__).parent.iterdir())
        source = b"".join(one.read_bytes() for one in own if one.suffix in (".py", ".toml"))
        options = {f"--{key.replace('_', '-')}": str(value) for key, value in self.asked.items()}
        depends = {
            **options,
            "what is studied": f"{self.discover.__module__}.{self.discover.__qualname__}",
            "source of the study": sha256(source).hexdigest(),
            **surroundings(),
            **own_files(),
        }
        return {"depends on": depends}


def content(study: Study, number: int, tell: Tell = silent) -> Content:
    """The row of a set, which is all that is stored of it."""
    task = study.tasks[number]
    tell(0, task.part)
    return Content({}, pa.Table.from_pylist([row(study.discover, task)]))


def sets_of(folder: Path, name: str, shards: int) -> pd.DataFrame:
    """The rows of those sets that are there, in their order."""
    there = [number for number in range(shards) if read(folder, name, number) is not None]
    rows = [frame_of(rows_of(folder, name, number)) for number in there]
    return pd.concat(rows, ignore_index=True)


def row(discover: Discover, task: Task) -> dict[str, object]:
    """What was planted in a set, what was reported, the errors and the time it took."""
    made = make_set(task)
    began, cpu_began = time.perf_counter(), time.process_time()
    findings = discover(made.train, made.test, task.seed)
    seconds, cpu_seconds = time.perf_counter() - began, time.process_time() - cpu_began
    return {
        **_described(task, made),
        **judged(task, made, findings),
        "seconds": seconds,
        "cpu_seconds": cpu_seconds,
    }


def _described(task: Task, made: SimulatedSet) -> dict[str, object]:
    planted, acts_on, rests_on, form = "+".join(task.effects) or "nothing", "", "", task.form
    if task.random is not None:
        acts_on, rests_on = task.random.acts_on, "*".join(task.random.columns)
        planted = f"{acts_on} by {rests_on}"
    if task.log is not None:
        form = f"{task.log.runs} x {task.log.points}, {task.log.wheel_speed_noise:g} m/s"
        form += f", r = {task.noise.autocorrelation:g}"
    return {
        "part": task.part,
        "planted": planted,
        "seed": task.seed,
        "base": made.base,
        "design": "operational" if task.operational else "designed",
        "form": form,
        **made.noise._asdict(),
        "wanted": np.nan if task.visible is None else task.visible,
        "visible": made.visible,
        "acts_on": acts_on,
        "rests_on": rests_on,
    }
