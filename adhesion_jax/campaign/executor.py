"""Units of work mapped over processes."""

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing.queues import Queue
from pathlib import Path
from typing import Any, TypeVar

from adhesion_jax import keeping, plugins, programs, runtime
from adhesion_jax.errors import WorkerError

T = TypeVar("T")


def _start(folder: Path, cores: Queue, parts: Sequence[plugins.Part]) -> None:
    runtime.take_core(cores)
    runtime.start()
    keeping.use(folder)
    programs.share_with_jax()
    for part in parts:
        plugins.use(part)


@contextmanager
def mapped(
    function: Callable[..., T], work: Sequence[tuple[Any, ...]], workers: int
) -> Iterator[Iterator[T]]:
    """`function(*unit)` of each unit, in the order of the work, from as many processes as asked.

    Processes rather than threads, because compiled programs that call LAPACK on stacks of large
    matrices deadlock when two run at once (`runtime.threads`); spawned ones, because a fork of a
    process in which jax runs is not safe. They share what they compile. WorkerError where one of
    them comes to an end before its work does.
    """
    if workers == 1:
        yield (function(*unit) for unit in work)
        return
    spawning = multiprocessing.get_context("spawn")
    cores = runtime.cores_for(workers, spawning)
    with ProcessPoolExecutor(
        workers,
        mp_context=spawning,
        initializer=_start,
        initargs=(keeping.folder(), cores, plugins.used()),
    ) as pool:
        try:
            yield pool.map(function, *zip(*work, strict=True))
        except BrokenProcessPool:
            raise WorkerError(
                "a worker process was killed, or had no memory left; nothing was written. "
                "Run the command again, with less beside it."
            ) from None
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
