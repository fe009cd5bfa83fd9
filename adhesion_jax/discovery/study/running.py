"""A study run: one row a set, in one process or in several."""

import multiprocessing
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from functools import partial
from multiprocessing.queues import Queue

import numpy as np
import pandas as pd

from adhesion_jax.discovery.findings import Findings
from adhesion_jax.discovery.simulator import Campaign
from adhesion_jax.discovery.study.judging import judged
from adhesion_jax.discovery.study.tasks import Task, make_set
from adhesion_jax.runtime import compilation_folder, cores_for, share_compilations, take_core

#: What is studied: training table, test table or none, and seed to findings.
Discover = Callable[[pd.DataFrame, pd.DataFrame | None, int], Findings]


def run_study(
    tasks: Sequence[Task],
    discover: Discover,
    progress: Callable[[str], None],
    workers: int = 1,
) -> pd.DataFrame:
    """One row a set: what was planted, what was reported, the errors and the time it took.

    With more than one worker in so many processes, which must be able to import `discover`; but
    for the times the rows are the same, in the order of the tasks.
    """
    rows = []
    with _mapped(tasks, discover, workers) as results:
        for task, row in zip(tasks, results, strict=True):
            rows.append(row)
            progress(task.part)
    return pd.DataFrame(rows)


@contextmanager
def _mapped(
    tasks: Sequence[Task], discover: Discover, workers: int
) -> Iterator[Iterator[dict[str, object]]]:
    """The rows in the order of the tasks, from processes that share what they compile.

    Spawned, because a fork of a process in which jax runs is not safe.
    """
    of_task = partial(_row, discover)
    if workers == 1:
        yield map(of_task, tasks)
        return
    spawning = multiprocessing.get_context("spawn")
    cores = cores_for(workers, spawning)
    with (
        compilation_folder() as folder,
        ProcessPoolExecutor(
            workers, mp_context=spawning, initializer=_start, initargs=(folder, cores)
        ) as pool,
    ):
        try:
            yield pool.map(of_task, tasks)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _start(folder: str, cores: Queue) -> None:
    take_core(cores)
    share_compilations(folder)


def _row(discover: Discover, task: Task) -> dict[str, object]:
    campaign = make_set(task)
    began, cpu_began = time.perf_counter(), time.process_time()
    findings = discover(campaign.train, campaign.test, task.seed)
    seconds, cpu_seconds = time.perf_counter() - began, time.process_time() - cpu_began
    return {
        **_described(task, campaign),
        **judged(task, campaign, findings),
        "seconds": seconds,
        "cpu_seconds": cpu_seconds,
    }


def _described(task: Task, campaign: Campaign) -> dict[str, object]:
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
        "base": campaign.base,
        "design": "operational" if task.operational else "designed",
        "form": form,
        **campaign.noise._asdict(),
        "wanted": np.nan if task.visible is None else task.visible,
        "visible": campaign.visible,
        "acts_on": acts_on,
        "rests_on": rests_on,
    }
