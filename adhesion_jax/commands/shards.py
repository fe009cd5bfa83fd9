"""What all commands share whose work is divided into shards."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from threading import Event, Thread

import click
from tqdm import tqdm

from adhesion_jax.campaign.executor import Engine, Work, terminable
from adhesion_jax.campaign.notes import Tell, notes
from adhesion_jax.campaign.store import Content, J, Job, missing, opened, recorded, stored
from adhesion_jax.errors import InputError
from adhesion_jax.files import refuse_folders, staged, writing_to

#: Seconds from one look at what is being computed to the next.
_PAUSE = 0.5


def extended(directory: Path, extend: int) -> int:
    """The number of runs of the job in a folder, and as many more as asked."""
    before = recorded(directory)
    if before is None:
        raise InputError(
            f"--extend adds runs to a job, and --out {directory} holds none; name its folder."
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
        terminable(),
        writing_to(directory),
        opened(directory, command, jobs, resume or extend > 0, extend) as folder,
        staged(directory, own, folder) as stage,
    ):
        yield folder, stage


def compute(
    content: Callable[[J, int, Tell], Content],
    jobs: Sequence[J],
    folder: Path,
    engine_for: Callable[[Work], Engine],
    unit: str = "run",
) -> None:
    """All shards that are not there; what is finished stays, however this ends.

    `engine_for` is given the work, and says what is to do it.
    """
    work = missing(folder, jobs)
    every = _runs((job, number) for job in jobs for number in range(job.shards))
    with tqdm(total=every, initial=every - _runs(work), desc="compiling", unit=unit) as bar:
        try:
            engine = engine_for(work)
            with (
                _watched(bar, folder, engine) as finish,
                engine.mapped(partial(stored, content), work, folder) as results,
            ):
                for runs in results:
                    finish(runs)
        except BaseException:
            there = every - _runs(missing(folder, jobs))
            bar.close()
            if there:
                click.echo(
                    f"{there} of {every} {unit}s are finished and stay in {folder}; the same "
                    "command with --resume computes the others.",
                    err=True,
                )
            raise


@contextmanager
def _watched(bar: tqdm, folder: Path, engine: Engine) -> Iterator[Callable[[int], None]]:
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
        bar.set_postfix_str(f"workers: {engine.workers}", refresh=False)
        # A shard that is finished counts when those before it are, too: until then nothing moves.
        if not bar.update(max(finished + sum(runs for runs, _ in now) - bar.n, 0)):
            bar.refresh()

    def watch() -> None:
        while not ended.wait(_PAUSE):
            show()

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
