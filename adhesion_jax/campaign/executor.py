"""Units of work mapped over processes."""

import ctypes
import multiprocessing
import os
import pickle
import signal
import traceback
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
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

#: Parameters of the allocator of glibc, and their values (bytes): memory that arrays leave is kept
#: for the next ones. Dask sets MALLOC_TRIM_THRESHOLD_ to 64 KiB for its workers, by which every
#: large array is new memory: 37,000 page faults a shard in place of 100, and 1.7 times the CPU
#: seconds, measured with shards of 4096 runs.
_ALLOCATOR = {-3: 2**25, -1: 2**28}  # M_MMAP_THRESHOLD, of which this is the most; M_TRIM_THRESHOLD

#: Results wait for those before them: units are begun at most this many a process ahead.
AHEAD = 16


@runtime_checkable
class Engine(Protocol):
    """What computes the units of a campaign: `Processes`, or a cluster (`cluster.engine_of`)."""

    @property
    def workers(self) -> int:
        """The number of processes that compute, as far as it is known now."""

    def mapped(
        self, function: Callable[..., T], work: Work, folder: Path | None = None
    ) -> AbstractContextManager[Iterator[T]]:
        """`function(*unit)` of each unit, in the order of the work.

        With a folder it is `function(*unit, folder)`: the function stores its files in the folder
        that it is given, which need not be that one; they are in that one when the result comes.
        """


@dataclass(frozen=True)
class Processes:
    """So many processes of this machine; 1 is this process."""

    workers: int

    def mapped(
        self, function: Callable[..., T], work: Work, folder: Path | None = None
    ) -> AbstractContextManager[Iterator[T]]:
        units = work if folder is None else [(*unit, folder) for unit in work]
        return mapped(function, units, self.workers)


@contextmanager
def terminable() -> Iterator[None]:
    """What SIGTERM asks for meanwhile is done as with Ctrl-C: by an exception, status 143."""

    def end(number: int, _: object) -> None:
        raise SystemExit(128 + number)

    before = signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextmanager
def mapped(function: Callable[..., T], work: Work, workers: int) -> Iterator[Iterator[T]]:
    """`function(*unit)` of each unit, in the order of the work, from as many processes as asked.

    Processes rather than threads, because compiled programs that call LAPACK on stacks of large
    matrices deadlock when two run at once (`runtime.threads`); spawned ones, because a fork of a
    process in which jax runs is not safe. They share what they compile. Another process takes the
    place of one that dies and tries its unit again; WorkerError where that has failed as often as
    it is tried. No process outlives this one, however it ends.
    """
    workers = min(workers, len(work))
    if workers <= 1:
        yield (function(*unit) for unit in work)
        return
    team: list[_Member] = []
    try:
        team += [_Member(function, core) for core in runtime.cores_of(workers)]
        yield _results(team, work)
    finally:
        for member in team:
            member.end()


@dataclass
class _Member:
    """A worker process, the core it keeps to, and the numbers of its units.

    It computes the first of them; the next waits with it, for else the process would wait for the
    parent between two units.
    """

    function: Callable[..., Any]
    core: int | None
    units: deque[int] = field(default_factory=deque)

    def __post_init__(self) -> None:
        spawning = multiprocessing.get_context("spawn")
        self.line, there = spawning.Pipe()
        arguments = (there, self.function, keeping.folder(), self.core, plugins.used())
        self.process: BaseProcess = spawning.Process(target=_serve, args=arguments, daemon=True)
        self.process.start()
        there.close()

    def begin(self, number: int, unit: tuple[Any, ...]) -> None:
        self.units.append(number)
        with suppress(OSError):  # where the process has died, its sentinel tells
            self.line.send(unit)

    def answer(self) -> tuple[bool, Any] | None:
        """Whether the unit succeeded, and its result or the error; None where there is none yet."""
        with suppress(EOFError, OSError):
            if self.line.poll():
                found: tuple[bool, Any] = self.line.recv()
                return found
        return None

    def end(self) -> None:
        self.process.terminate()
        self.process.join()
        self.line.close()


def _results(team: list[_Member], work: Work) -> Iterator[Any]:
    """The results in the order of the work; members that die are replaced."""
    left = deque(range(len(work)))
    deaths = dict.fromkeys(left, 0)
    found: dict[int, Any] = {}
    for number in range(len(work)):
        while number not in found:
            for waiting, least in ((0, 1), (1, len(team))):  # the last units are for who is free
                for member in team:
                    ahead = len(left) >= least and left[0] < number + AHEAD * len(team)
                    if ahead and len(member.units) == waiting:
                        following = left.popleft()
                        member.begin(following, work[following])
            wait([end for m in team for end in (m.line, m.process.sentinel)])
            for place, member in enumerate(team):
                answer = member.answer()
                if answer is not None:
                    found[member.units.popleft()] = answer
                elif not member.process.is_alive():
                    team[place] = _replaced(member, deaths, left)
        succeeded, result = found.pop(number)
        if not succeeded:
            raise result
        yield result


def _replaced(dead: _Member, deaths: dict[int, int], left: deque[int]) -> _Member:
    """A member in the place of one that died; its units are the next to be tried."""
    dead.end()
    if dead.units:
        deaths[dead.units[0]] += 1
        if deaths[dead.units[0]] == TRIES:
            raise died(TRIES)
        left.extendleft(reversed(dead.units))
    return _Member(dead.function, dead.core)


def died(times: int) -> WorkerError:
    return WorkerError(
        f"a worker process was killed, or had no memory left, {times} times at the same piece of "
        "work. Run the command again, with less beside it."
    )


def _serve(
    line: Connection,
    function: Callable[..., Any],
    folder: Path,
    core: int | None,
    parts: Sequence[plugins.Part],
) -> None:
    """The life of a worker process: it answers one unit after another."""
    Thread(target=_end_with_parent, daemon=True).start()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, which ends this one
    units: SimpleQueue[bytes] = SimpleQueue()
    # A thread takes them from the line, so that the parent never waits until it can send one.
    Thread(target=_receive, args=(line, units), daemon=True).start()
    prepare(core, folder, parts)
    while True:
        content = units.get()
        line.send_bytes(answered(_called, (function, content)))


def _receive(line: Connection, units: "SimpleQueue[bytes]") -> None:
    with suppress(EOFError, OSError):
        while True:
            units.put(line.recv_bytes())
    os._exit(0)  # the parent has closed the line: there is no more to do


def _called(function: Callable[..., Any], content: bytes) -> Any:
    return function(*pickle.loads(content))


def prepare(core: int | None, folder: Path | None, parts: Sequence[plugins.Part]) -> None:
    """Make a worker process ready before jax opens a device: core, memory, flags, programs, parts.

    Without a folder the programs are kept where the process itself keeps them.
    """
    runtime.take_core(core)
    with suppress(OSError, TypeError, AttributeError):  # where there is another C library
        allocator = ctypes.CDLL(None)
        for parameter, value in _ALLOCATOR.items():
            allocator.mallopt(parameter, value)
    runtime.start()
    if folder is not None:
        keeping.use(folder)
    programs.share_with_jax()
    for part in parts:
        plugins.use(part)


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def answered(function: Callable[..., Any], unit: tuple[Any, ...]) -> bytes:
    """Whether the unit succeeded, and its result or the error: a pickle of both."""
    try:
        return pickle.dumps((True, function(*unit)), pickle.HIGHEST_PROTOCOL)
    except Exception as error:
        told = traceback.format_exc()
        error.add_note(f"In a worker process:\n{told}")
        try:
            return pickle.dumps((False, error))
        except (pickle.PicklingError, AttributeError, TypeError):
            return pickle.dumps((False, RuntimeError(told)))
