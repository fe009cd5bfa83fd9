"""The workers of a Dask cluster, one that is joined or started here, as a pool.

A unit travels as bytes, and becomes objects in a worker that was prepared for it as the processes
of `pool` are. It sends what it has stored, so that files come to the folder of the results by this
process alone: a worker that goes on after its job has ended changes nothing there.
"""

import logging
import os
import pickle
import platform
import sys
import time
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from functools import cache, partial
from importlib.metadata import version
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar
from uuid import uuid4
from weakref import WeakSet

from adhesion_jax import keeping, plugins, programs, runtime
from adhesion_jax.campaign.pool import TRIES, Pool, Processes, Work, died, finished, prepare
from adhesion_jax.campaign.store import write
from adhesion_jax.errors import InputError, WorkerError

T = TypeVar("T")

#: `local:2` asks for a cluster of two workers on this machine.
LOCAL = "local:"

#: Seconds that a scheduler has to answer, and the first worker to join it.
_PATIENCE = 10

#: Seconds for which the number of workers is taken to be what it was.
_COUNTED_FOR = 2.0

#: Ctrl-C is for this process, which ends its workers; a terminal sends it to them, too.
_IGNORE_CTRL_C = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)"

#: What a unit has stored: the content of files by their names.
_Stored = Mapping[str, bytes]


@contextmanager
def pool_of(workers: int, cluster: str | None) -> Iterator[Pool]:
    """`workers` processes of this machine or, if one is named, a cluster, started or joined.

    `cluster` is `local:N` or the address of a scheduler. InputError where it cannot be reached, has
    no workers, or has other versions than this process. What was started here ends with it.
    """
    if cluster is None:
        yield Processes(workers)
        return
    local = int(cluster.removeprefix(LOCAL)) if cluster.startswith(LOCAL) else 0
    # No words of dask about connections that are lost and workers that are replaced.
    quiet = _distributed().utils.silence_logging_cmgr(logging.CRITICAL)
    with quiet, _started(local) if local else _joined(cluster) as client:
        setting = versions(), plugins.used(), runtime.cores_of(local)
        pool = _Cluster(client, pickle.dumps(setting))
        pool.prepare()
        yield pool


@contextmanager
def _started(workers: int) -> Iterator[Any]:
    """A client of a cluster of this machine, whose processes end with it."""
    distributed = _distributed()
    import dask

    settings = {
        "distributed.scheduler.allowed-failures": TRIES - 1,
        # When the next cluster starts, Dask removes there what killed workers have left.
        "temporary-directory": str(keeping.folder() / "dask"),
    }
    with (
        dask.config.set(settings),
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
    except (OSError, ValueError, AssertionError) as error:
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
    """The workers that a client has, as a pool; they may come and go."""

    client: Any
    setting: bytes
    workers: int = 0  # when they were counted

    def prepare(self) -> None:
        """Prepare the workers that are there; InputError where one cannot serve."""
        begun = {
            worker: self.client.submit(_prepared, self.setting, pure=False, workers=[worker])
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
    def stored(self, function: Callable[..., T], work: Work, folder: Path) -> Iterator[Iterator[T]]:
        name, numbers = f"unit-{uuid4().hex}", count()
        begun, called = WeakSet[Any](), partial(plugins.worded, function)

        def submit(*unit: Any) -> Any:
            # As bytes, which Dask does not look into. Units of one name wait at the scheduler.
            call, key = pickle.dumps((called, unit)), (name, next(numbers))
            begun.add(future := self.client.submit(_done, self.setting, call, key=key))
            return future

        try:
            with closing(self._results(finished(submit, dict(enumerate(work))), folder)) as results:
                yield results
        finally:
            # A cancellation, also of nothing, is told to all clients, and one that joins at that
            # moment is lost. Where the scheduler has gone, they have ended.
            if waiting := [future for future in begun if not future.done()]:
                with suppress(Exception):
                    self.client.cancel(waiting)

    def _results(
        self, ended: Iterator[tuple[int, Any]], folder: Path
    ) -> Generator[Any, None, None]:
        counted = time.monotonic()
        for _, future in ended:
            result, stored = _answer(future)
            for name, content in stored.items():
                write(folder / name, content)
            if time.monotonic() > counted + _COUNTED_FOR:
                counted = time.monotonic()
                with suppress(OSError):  # the next answer tells that the scheduler has gone
                    self.workers = len(self.client.nthreads())
            yield result


def _answer(future: Any) -> tuple[Any, _Stored]:
    """The result of a unit and what it has stored; WorkerError where no worker could do it."""
    distributed = _distributed()
    try:
        answer: tuple[Any, _Stored] = future.result()
    except distributed.KilledWorker as error:
        raise died(error.allowed_failures + 1) from None
    except (distributed.CancelledError, OSError) as error:
        if future.status == "error":  # it is the unit that had no space to write to, say
            raise
        raise WorkerError(
            f"the connection to the cluster was lost ({_told(error)}). Run the command again when "
            "its scheduler is back."
        ) from None
    return answer


# What follows is done in a worker.


def _done(setting: bytes, call: bytes) -> tuple[Any, _Stored]:
    """The result of a unit, and what it has stored in a folder of its own, of which it is told.

    It lies where Dask removes what workers that are killed have left.
    """
    from distributed import get_worker

    _prepare(setting)
    function, unit = pickle.loads(call)
    with TemporaryDirectory(dir=get_worker().local_directory) as passing:
        result = function(*unit, Path(passing))
        return result, {path.name: path.read_bytes() for path in Path(passing).iterdir()}


def _prepared(setting: bytes) -> str:
    """The kind of processor of this worker, which is now prepared."""
    _prepare(setting)
    return programs.processor()


@cache
def _prepare(setting: bytes) -> None:
    """Prepare this worker, once for each setting; InputError where it cannot serve."""
    from distributed import get_worker

    worker = get_worker()
    asked, parts, cores = pickle.loads(setting)
    if worker.state.nthreads != 1:
        raise InputError(
            f"The worker {worker.address} has {worker.state.nthreads} threads, and two compiled "
            "programs in one process may wait for each other for ever; start it with --nthreads 1."
        )
    runtime.start()
    for (name, there), (_, here) in zip(versions(), asked, strict=True):
        if here != there:
            raise InputError(
                f"The worker {worker.address} has {name} {there or 'not set'}, and this machine "
                f"has {here or 'not set'}; make them the same."
            )
    if cores:  # of workers of this machine, whose names are numbers
        runtime.take_core(cores[int(worker.name)])
    try:
        prepare(parts)
    except InputError as error:
        raise InputError(
            f"{error} The worker {worker.address} has the files of earlier jobs, too: if that is "
            "why, restart it."
        ) from None
