"""What all share whose work is divided into shards: the folder, and what goes on there."""

import math
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from numbers import Integral, Real
from os import PathLike
from pathlib import Path
from threading import Event, Thread, current_thread, main_thread

from tqdm import tqdm

from adhesion_jax.campaign.pool import Pool, Work
from adhesion_jax.campaign.store import (
    Content,
    J,
    Job,
    Tell,
    missing,
    notes,
    opened,
    recorded,
    stored,
)
from adhesion_jax.errors import InputError
from adhesion_jax.files import refuse_folders, staged, writing_to
from adhesion_jax.options import MOST_RUNS

#: Seconds from one look at what is being computed to the next.
_PAUSE = 0.5


def check_numbers(runs: int, workers: int, seed: int, fewest: int = 1, seeds: int = 1) -> None:
    """InputError where a number of runs or workers, or the first of some seeds, cannot be."""
    whole = all(isinstance(one, Integral) for one in (runs, workers, seed))
    if not (whole and fewest <= runs <= MOST_RUNS and workers > 0 and 0 <= seed <= 2**32 - seeds):
        raise InputError(
            f"runs are from {fewest} to {MOST_RUNS:,}, workers 1 or more, and a seed is from 0 to "
            f"2**32 - {seeds}, all whole numbers."
        )


def step_of(step: float | None, default: float) -> float:
    """The step that is asked for in s, or the default."""
    if step is not None and not (isinstance(step, Real) and 0 < step < math.inf):
        raise InputError(f"a step is a number of seconds above 0, and not {step!r}.")
    return default if step is None else float(step)


def extended(out: str | PathLike[str] | None, runs: int, resume: bool, extend: int) -> int:
    """The number of runs; to extend is to add to that of the job in the folder."""
    if not isinstance(extend, Integral) or extend < 0:
        raise InputError(f"extend is a whole number of further runs, and not {extend!r}.")
    if not resume and not extend:
        return runs
    if out is None:
        raise InputError("resume and extend go on with the job in a folder; name it as out.")
    if not extend:
        return runs
    before = recorded(Path(out))
    if before is None:
        raise InputError(
            f"--extend adds runs to a job, and --out {out} holds none; name its folder."
        )
    return int(before["runs"]) + extend


@contextmanager
def opened_for(
    command: str,
    jobs: Sequence[Job],
    directory: Path,
    own: Sequence[str],
    resume: bool,
    extend: int = 0,
) -> Iterator[tuple[Path, Path]]:
    """The folder of the shards of a command, and one for its results, whose names are `own`."""
    refuse_folders(directory, own)
    with (
        _terminable(),
        writing_to(directory),
        opened(directory, command, jobs, resume or extend > 0, extend) as folder,
        staged(directory, own, folder) as stage,
    ):
        yield folder, stage


@contextmanager
def _terminable() -> Iterator[None]:
    """What SIGTERM asks for meanwhile is done as with Ctrl-C: by an exception, status 143."""

    def end(number: int, _: object) -> None:
        raise SystemExit(128 + number)

    if current_thread() is not main_thread():  # where no answer to a signal can be set
        yield
        return
    before = signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def compute(
    content: Callable[[J, int, Tell], Content],
    jobs: Sequence[J],
    folder: Path,
    pool_for: Callable[[Work], Pool],
    unit: str = "run",
) -> None:
    """All shards that are not there; what is finished stays, however this ends.

    `pool_for` is given the work, and says what is to do it.
    """
    work = missing(folder, jobs)
    every = _runs((job, number) for job in jobs for number in range(job.shards))
    begun = every - _runs(work)
    with tqdm(total=every, initial=begun, desc="compiling", unit=unit, disable=None) as bar:
        try:
            pool = pool_for(work)
            with (
                _watched(bar, folder, pool) as finish,
                pool.stored(partial(stored, content), work, folder) as results,
            ):
                for runs in results:
                    finish(runs)
        except BaseException:
            there = every - _runs(missing(folder, jobs))
            bar.close()
            if there:
                print(
                    f"{there} of {every} {unit}s are finished and stay in {folder}; the same "
                    "command with --resume computes the others.",
                    file=sys.stderr,
                )
            raise


@contextmanager
def _watched(bar: tqdm, folder: Path, pool: Pool) -> Iterator[Callable[[int], None]]:
    """Show what goes on in a folder, and how many runs are done; takes the runs of each shard."""
    finished = began = bar.n
    ended = Event()

    def finish(runs: int) -> None:
        nonlocal finished
        finished += runs

    def show() -> None:
        now = notes(folder)
        words = dict.fromkeys(words for _, words in now)
        without_notes = "computing" if finished > began else "starting"
        bar.set_description(", ".join(words) or without_notes, refresh=False)
        bar.set_postfix_str(f"workers: {pool.workers}", refresh=False)
        # A shard that was begun anew has fewer runs than it had: until it has more nothing moves.
        if not bar.update(max(finished + sum(runs for runs, _ in now) - bar.n, 0)):
            bar.refresh()

    def watch() -> None:
        while not ended.wait(_PAUSE):
            show()

    if bar.disable:
        yield finish
        return
    show()
    watcher = Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield finish
    finally:
        ended.set()
        watcher.join()
        bar.set_description(refresh=False)
        bar.update(max(finished - bar.n, 0))


def _runs(work: Iterator[tuple[Job, int]] | Sequence[tuple[Job, int]]) -> int:
    return sum(job.runs_of(number) for job, number in work)
