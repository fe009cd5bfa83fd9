"""Units of work mapped over a pool: processes of this machine, or a cluster (`cluster.pool_of`)."""

import ctypes
import os
import signal
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, closing, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from itertools import islice
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from queue import SimpleQueue
from threading import Thread
from typing import Any, Protocol, TypeVar, runtime_checkable

from adhesion_jax import keeping, plugins, programs, runtime
from adhesion_jax.errors import WorkerError

T = TypeVar("T")

Work = Sequence[tuple[Any, ...]]

#: Number of times that a unit is tried whose process dies.
TRIES = 3

#: Largest number of units that are given out at once: memory does not grow with their total.
_GIVEN_OUT = 1000

#: Parameters of the allocator of glibc, and their values (bytes): memory that arrays leave is kept
#: for the next ones. Dask sets MALLOC_TRIM_THRESHOLD_ to 64 KiB for its workers, by which every
#: large array is new memory: 37,000 page faults a shard in place of 100, and 1.7 times the CPU
#: seconds, measured with shards of 4096 runs.
_ALLOCATOR = {-3: 2**25, -1: 2**28}  # M_MMAP_THRESHOLD, of which this is the most; M_TRIM_THRESHOLD


@runtime_checkable
class Pool(Protocol):
    """What computes the units of a campaign."""

    @property
    def workers(self) -> int:
        """The number of processes that compute, as far as it is known now."""

    def stored(
        self, function: Callable[..., T], work: Work, folder: Path
    ) -> AbstractContextManager[Iterator[T]]:
        """`function(*unit, folder)` of each unit, as they end.

        The function stores its files in the folder that it is given, which need not be that one;
        they are in that one when the result comes.
        """


@dataclass(frozen=True)
class Processes:
    """`workers` processes of this machine; 1 is this process.

    Processes rather than threads, because compiled programs that call LAPACK on stacks of large
    matrices deadlock when two run at once (`runtime.threads`); spawned ones, because a fork of a
    process in which jax runs is not safe. They share what they compile. Where one dies, the units
    that may have been its last are tried again one by one; WorkerError where one of them ends its
    process as often as a unit is tried.
    No process outlives this one, however it ends.
    """

    workers: int

    @contextmanager
    def stored(self, function: Callable[..., T], work: Work, folder: Path) -> Iterator[Iterator[T]]:
        with closing(self._finished(function, [(*unit, folder) for unit in work])) as found:
            yield (result for _, result in found)

    @contextmanager
    def mapped(self, function: Callable[..., T], work: Work) -> Iterator[Iterator[T]]:
        """`function(*unit)` of each unit, in the order of the work."""
        with closing(self._finished(function, work)) as found:
            yield _in_order(found)

    def _finished(
        self, function: Callable[..., T], work: Work
    ) -> Generator[tuple[int, T], None, None]:
        workers = min(self.workers, len(work))
        if workers <= 1:
            yield from ((number, function(*unit)) for number, unit in enumerate(work))
            return
        left, tried, one_by_one = dict(enumerate(work)), Counter[int](), False
        while left:
            # Which of the units that were computed ended its process is seen where one process
            # computes them in their order: it is the first that has no result.
            units = dict(islice(left.items(), workers)) if one_by_one else left
            try:
                with _started(1 if one_by_one else workers) as executor:
                    begin = partial(executor.submit, plugins.worded, function)
                    for number, future in finished(begin, units):
                        result = future.result()
                        del left[number]
                        yield number, result
                one_by_one = False
            except BrokenProcessPool:
                if one_by_one:
                    first = min(left)
                    tried[first] += 1
                    if tried[first] == TRIES:
                        raise died(TRIES) from None
                one_by_one = True


def finished(
    submit: Callable[..., Any], units: Mapping[int, tuple[Any, ...]]
) -> Iterator[tuple[int, Any]]:
    """The number and the future of each unit as they end; `submit(*unit)` begins one."""
    done: SimpleQueue[Any] = SimpleQueue()
    begun: dict[Any, int] = {}
    left = iter([*units.items()])
    for _ in range(len(units)):
        for number, unit in islice(left, _GIVEN_OUT - len(begun)):
            future = submit(*unit)
            begun[future] = number
            future.add_done_callback(done.put)
        future = done.get()
        yield begun.pop(future), future


def _in_order(found: Iterable[tuple[int, T]]) -> Iterator[T]:
    """Numbered results by their numbers: those that come too early wait."""
    waiting: dict[int, T] = {}
    following = 0
    for number, result in found:
        waiting[number] = result
        while following in waiting:
            yield waiting.pop(following)
            following += 1


@contextmanager
def _started(workers: int) -> Iterator[ProcessPoolExecutor]:
    """Processes, each on a core of its own, that end with this context or this process."""
    spawning = get_context("spawn")
    cores = spawning.SimpleQueue()
    for core in runtime.cores_of(workers):
        cores.put(core)
    theirs, own = spawning.Pipe(duplex=False)
    arguments = theirs, cores, keeping.folder(), plugins.used()
    executor = ProcessPoolExecutor(workers, spawning, _begin, arguments)
    try:
        yield executor
    finally:
        own.close()
        executor.shutdown(cancel_futures=True)
        theirs.close()


def _begin(line: Connection, cores: Any, folder: Path, parts: Sequence[plugins.Part]) -> None:
    """Begin the life of a worker process, which ends when the other end of the line is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, which ends this one
    Thread(target=_end_with, args=(line,), daemon=True).start()
    runtime.take_core(cores.get())
    keeping.use(folder)
    prepare(parts)


def _end_with(line: Connection) -> None:
    with suppress(EOFError, OSError):
        line.recv()
    os._exit(1)


def prepare(parts: Sequence[plugins.Part]) -> None:
    """Make a worker process ready before jax opens a device: memory, flags, programs, parts."""
    with suppress(OSError, TypeError, AttributeError):  # where there is another C library
        allocator = ctypes.CDLL(None)
        for parameter, value in _ALLOCATOR.items():
            allocator.mallopt(parameter, value)
    runtime.start()
    programs.share_with_jax()
    for part in parts:
        plugins.use(part)


def died(times: int) -> WorkerError:
    return WorkerError(
        f"a worker process was killed, or had no memory left, {times} times at the same piece of "
        "work. Run the command again, with less beside it."
    )
