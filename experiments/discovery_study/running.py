"""What a discovery makes of a set of the study: a row."""

import time
from collections.abc import Callable

import numpy as np
import pandas as pd

from adhesion_jax.discovery.types import Findings
from adhesion_jax.library.discover import discover
from experiments.campaigns.simulator import SimulatedSet
from experiments.discovery_study.judging import judged
from experiments.discovery_study.tasks import Task, make_set

#: What is studied: training table, test table or none, and seed to findings.
Discover = Callable[[pd.DataFrame, pd.DataFrame | None, int], Findings]


def discovered(train: pd.DataFrame, test: pd.DataFrame | None, seed: int) -> Findings:
    """The findings that a user gets from these tables; reading them is included."""
    return discover(train, test, seed=seed).findings


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
