"""Units of work mapped over the workers of a Dask cluster, one that is joined or started here.

A unit travels as bytes, and becomes objects in a worker that was prepared for it as the processes
of `executor` are. Files come to the folder of the results by this process alone, so that a worker
that goes on after its job has ended changes nothing there.
"""

import logging
import os
import pickle
import platform
import shutil
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple, TypeVar
from uuid import uuid4

from adhesion_jax import keeping, plugins, programs, runtime
from adhesion_jax.campaign.executor import (
    AHEAD,
    TRIES,
    Engine,
    Processes,
    Work,
    answered,
    died,
    prepare,
)
from adhesion_jax.errors import InputError, WorkerError

T = TypeVar("T")

#: `local:2` asks for a cluster of two workers on this machine.
LOCAL = "local:"

#: Seconds that a scheduler has to answer, and the first worker to join it.
_PATIENCE = 10

#: Quick units go to a worker several at once, as many as take about so many seconds, and at most so
#: many: to give out and to bring back one by one took 3 to 5 ms of CPU time each. So many times the
#: number that AHEAD says may then wait for those before them.
_LONG_ENOUGH, _MOST_TOGETHER = 0.5, 16

#: Seconds for which the number of workers is taken to be what it was.
_COUNTED_FOR = 2.0

#: How a cluster of this machine differs from dask's own settings: a unit is tried as often as by
#: `executor`, and processes watch themselves less, which took 3 % of a core each.
_LOCALLY = {
    "distributed.scheduler.allowed-failures": TRIES - 1,
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "10s",
}

#: Ctrl-C is for this process, which ends its workers; a terminal sends it to them, too.
_IGNORE_CTRL_C = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)"


class _Setting(NamedTuple):
    """What a worker is prepared for."""

    versions: tuple[tuple[str, str], ...]
    parts: tuple[plugins.Part, ...]
    programs: Path | None  # where workers of this machine keep them
    cores: tuple[int | None, ...]  # of workers of this machine, whose names are numbers


class _Files(NamedTuple):
    """What a unit has stored: files in the folder of the results, or their content by name."""

    there: Path | None
    content: Mapping[str, bytes]


@contextmanager
def engine_of(workers: int, cluster: str | None, shared: bool = False) -> Iterator[Engine]:
    """So many processes of this machine or, if one is named, a cluster that is started or joined.

    `cluster` is `local:N` or the address of a scheduler. `shared` says that its workers see the
    folder of the results by the same path as this process, and write there; otherwise they send
    what they have stored. InputError where the cluster cannot be reached, has no workers, or has
    other versions than this process. What was started here ends with it.
    """
    if cluster is None:
        yield Processes(workers)
        return
    local = int(cluster.removeprefix(LOCAL)) if cluster.startswith(LOCAL) else None
    with _quiet(), _joined(cluster) if local is None else _started(local) as client:
        setting = _Setting(
            versions(),
            plugins.used(),
            None if local is None else keeping.folder(),
            () if local is None else tuple(runtime.cores_of(local)),
        )
        engine = _Cluster(client, pickle.dumps(setting), shared or local is not None)
        engine.prepare()
        yield engine


def _quiet() -> AbstractContextManager[None]:
    """No words of dask about connections that are lost and workers that are replaced."""
    quiet: AbstractContextManager[None] = _distributed().utils.silence_logging_cmgr(
        logging.CRITICAL
    )
    return quiet


@contextmanager
def _started(workers: int) -> Iterator[Any]:
    """A client of a cluster of this machine, whose processes end with it."""
    distributed = _distributed()
    import dask

    # When the next cluster starts, Dask removes there what workers of killed processes have left.
    folder = str(keeping.folder() / "dask")
    with (
        dask.config.set({**_LOCALLY, "temporary-directory": folder}),
        distributed.LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            memory_limit=0,
            dashboard_address="127.0.0.1:0",
            preload=_IGNORE_CTRL_C,
            silence_logs=logging.CRITICAL,
        ) as cluster,
        distributed.Client(cluster, set_as_default=False) as client,
    ):
        yield client


@contextmanager
def _joined(address: str) -> Iterator[Any]:
    """A client of the scheduler there."""
    try:
        client = _distributed().Client(address, timeout=_PATIENCE, set_as_default=False)
    except (OSError, ValueError) as error:
        raise InputError(
            f"--cluster {address} cannot be reached ({_told(error)}); start a scheduler there by "
            "`dask scheduler`, or name the address of another one."
        ) from None
    with client:
        try:
            client.wait_for_workers(1, timeout=_PATIENCE)
        except TimeoutError:
            raise InputError(
                f"--cluster {address} has no workers; start some by "
                f"`dask worker {address} --nthreads 1`."
            ) from None
        yield client


def _distributed() -> Any:
    """Dask distributed, which is an extra and takes long to import."""
    try:
        import distributed
    except ImportError:
        raise InputError(
            "--cluster needs the package distributed, which is not installed; install it by "
            "pip install 'adhesion-jax[cluster]'."
        ) from None
    return distributed


def _told(error: BaseException) -> str:
    """The first cause of an error in one line."""
    while error.__cause__ is not None:
        error = error.__cause__
    return " ".join(f"{type(error).__name__}: {error}".split()).rstrip(".: ")


def versions() -> tuple[tuple[str, str], ...]:
    """What must be the same in all processes of a job for the same numbers."""
    return (
        ("python", platform.python_version()),
        *((name, version(name)) for name in runtime.PACKAGES),
        ("source of adhesion-jax", keeping.of_package()[:16]),
        ("XLA_FLAGS", os.environ.get("XLA_FLAGS", "")),
    )


@dataclass
class _Cluster:
    """The workers that a client has, as an engine; they may come and go."""

    client: Any
    setting: bytes
    shared: bool
    workers: int = 0  # when they were counted
    counted: float = -_COUNTED_FOR

    def _count(self) -> int:
        if time.monotonic() > self.counted + _COUNTED_FOR:
            self.workers, self.counted = len(self.client.nthreads()), time.monotonic()
        return self.workers

    def prepare(self) -> None:
        """Prepare the workers that are there; InputError where one cannot serve."""
        begun = {
            worker: self.client.submit(
                _prepared, self.setting, key=f"prepare-{uuid4().hex}", workers=[worker]
            )
            for worker in self.client.nthreads()
        }
        others, self.workers = 0, len(begun)
        for worker, future in begun.items():
            try:
                others += future.result() != programs.processor()
            except InputError:
                raise
            except Exception as error:
                raise InputError(
                    f"The worker {worker} cannot load adhesion-jax ({_told(error)}); install "
                    f"adhesion-jax {version('adhesion-jax')} where it runs."
                ) from None
        if others:
            print(
                f"{others} of {len(begun)} workers have another kind of processor than this "
                "machine: the last digits of what they compute may differ from those of this one.",
                file=sys.stderr,
            )

    @contextmanager
    def mapped(
        self, function: Callable[..., T], work: Work, folder: Path | None = None
    ) -> Iterator[Iterator[T]]:
        begun: dict[Any, list[int]] = {}
        place = folder / f".partial-{uuid4().hex}" if folder is not None and self.shared else None
        if place is not None:
            place.mkdir()
        try:
            yield self._results(begun, function, work, folder, place)
        finally:
            with suppress(Exception):  # a scheduler that has gone has ended them
                self.client.cancel([*begun])
            if place is not None:
                shutil.rmtree(place, ignore_errors=True)

    def _results(
        self,
        begun: dict[Any, list[int]],  # the numbers of units that are computed, by their futures
        function: Callable[..., T],
        work: Work,
        folder: Path | None,
        place: Path | None,
    ) -> Iterator[T]:
        """The results in the order of the work."""
        name = f"unit-{uuid4().hex}"  # those of one name wait at the scheduler
        completed = _distributed().as_completed(loop=self.client.loop)
        left = deque(range(len(work)))
        found: dict[int, Any] = {}
        together = 1
        for number in range(len(work)):
            while number not in found:
                workers = max(self._count(), 1)
                while left and left[0] < number + AHEAD * workers * together:
                    # Groups become smaller at the end, so that no worker waits.
                    count = min(together, -(-len(left) // (2 * workers)))
                    units = [left.popleft() for _ in range(count)]
                    future = self.client.submit(
                        _all_done,
                        self.setting,
                        # As bytes, which Dask does not look into.
                        pickle.dumps([pickle.dumps((function, work[unit])) for unit in units]),
                        place,
                        folder is not None,
                        key=(name, units[0]),
                        priority=-units[0],
                    )
                    begun[future] = units
                    completed.add(future)
                future = next(completed)
                units = begun.pop(future)
                answers, seconds = _answers(future)
                together = max(1, min(_MOST_TOGETHER, int(_LONG_ENOUGH * len(units) / seconds)))
                for unit, answer in zip(units, answers, strict=True):
                    succeeded, result = pickle.loads(answer)
                    if not succeeded:
                        raise result
                    found[unit], files = result
                    if folder is not None:
                        _bring(files, folder)
            yield found.pop(number)


def _answers(future: Any) -> tuple[list[bytes], float]:
    """The answer of each unit, and the seconds that all took; WorkerError where none could try."""
    distributed = _distributed()
    try:
        answers: tuple[list[bytes], float] = future.result()
    except distributed.KilledWorker as error:
        raise died(error.allowed_failures + 1) from None
    except (distributed.CancelledError, OSError) as error:
        raise WorkerError(
            f"the connection to the cluster was lost ({_told(error)}). Run the command again when "
            "its scheduler is back."
        ) from None
    return answers


def _bring(files: _Files, folder: Path) -> None:
    """Bring what a unit has stored to where it belongs, each file whole or not at all."""
    if files.there is None:
        for name, content in files.content.items():
            partly = folder / f".partial-{name}"
            partly.write_bytes(content)
            os.replace(partly, folder / name)
        return
    try:
        for path in [*files.there.iterdir()]:
            os.replace(path, folder / path.name)
        files.there.rmdir()
    except FileNotFoundError:
        raise _not_shared(folder) from None


def _not_shared(folder: Path) -> InputError:
    return InputError(
        f"--shared-folder: a worker does not see the files of {folder}; leave that option out, "
        "and workers send what they have stored."
    )


# What follows is done in a worker.


def _prepared(setting: bytes) -> str:
    """The kind of processor of this worker, which is now prepared."""
    _prepare(setting)
    return programs.processor()


@cache
def _prepare(setting: bytes) -> None:
    """Prepare this worker, once for each setting; InputError where it cannot serve."""
    from distributed import get_worker

    worker = get_worker()
    asked: _Setting = pickle.loads(setting)
    if worker.state.nthreads != 1:
        raise InputError(
            f"The worker {worker.address} has {worker.state.nthreads} threads, and two compiled "
            "programs in one process may wait for each other for ever; start it with --nthreads 1."
        )
    runtime.start()
    for (name, there), (_, here) in zip(versions(), asked.versions, strict=True):
        if here != there:
            raise InputError(
                f"The worker {worker.address} has {name} {there or 'not set'}, and this machine "
                f"has {here or 'not set'}; make them the same."
            )
    core = asked.cores[int(worker.name)] if asked.cores else None
    try:
        prepare(core, asked.programs, asked.parts)
    except InputError as error:
        raise InputError(
            f"{error} The worker {worker.address} has the files of earlier jobs, too: if that is "
            "why, restart it."
        ) from None


def _all_done(
    setting: bytes, calls: bytes, place: Path | None, stores: bool
) -> tuple[list[bytes], float]:
    """The answers of some units, and the seconds that they took."""
    began = time.perf_counter()
    answers = [_done(setting, call, place, stores) for call in pickle.loads(calls)]
    return answers, time.perf_counter() - began


def _done(setting: bytes, call: bytes, place: Path | None, stores: bool) -> bytes:
    """The answer of a unit, and what it has stored in a folder of its own, of which it is told."""

    def done() -> tuple[Any, _Files]:
        _prepare(setting)
        function, unit = pickle.loads(call)
        if not stores:
            return function(*unit), _Files(None, {})
        if place is not None:
            own = place / uuid4().hex
            try:
                own.mkdir()
            except FileNotFoundError:
                raise _not_shared(place.parent) from None
            return function(*unit, own), _Files(own, {})
        with TemporaryDirectory(prefix="adhesion_jax-") as passing:
            value = function(*unit, Path(passing))
            files = {path.name: path.read_bytes() for path in Path(passing).iterdir()}
        return value, _Files(None, files)

    return answered(done, ())
