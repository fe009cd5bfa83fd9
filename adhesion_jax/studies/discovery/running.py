"""A study run: one row a set, in one process or in several."""

import time
from collections.abc import Callable, Sequence

import numpy as np
import pandas as pd

from adhesion_jax.campaign.executor import mapped
from adhesion_jax.discovery.types import Findings
from adhesion_jax.simulation.simulator import SimulatedSet
from adhesion_jax.studies.discovery.judging import judged
from adhesion_jax.studies.discovery.tasks import Task, make_set

#: What is studied: training table, test table or none, and seed to findings.
Discover = Callable[[pd.DataFrame, pd.DataFrame | None, int], Findings]


def run_study(
    tasks: Sequence[Task],
    discover: Discover,
    progress: Callable[[str], None],
    workers: int = 1,
) -> pd.DataFrame:
    """One row a set: what was planted, what was reported, the errors and the time it took.

    More than one worker means that number of processes, which must be able to import `discover`;
    the rows are the same, in the order of the tasks, save the times.
    """
    rows = []
    with mapped(_row, [(discover, task) for task in tasks], workers) as results:
        for task, row in zip(tasks, results, strict=True):
            rows.append(row)
            progress(task.part)
    return pd.DataFrame(rows)


def _row(discover: Discover, task: Task) -> dict[str, object]:
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
