"""How jax is started: the one place where XLA flags and the precision are set.

Imported first by the package, so that the flags stand before jax opens a device. A program
that has already opened one keeps what it has; `describe` tells what is in force.
"""

import os
import pickle
import platform
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from hashlib import sha256
from importlib.metadata import version
from itertools import cycle
from multiprocessing.context import BaseContext
from multiprocessing.queues import Queue
from pathlib import Path
from tempfile import TemporaryDirectory

#: Cores this process may use; a campaign starts one worker process on each.
CORES = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1

# One thread a process: a sum is then taken in the same order whatever the number of cores.
_FLAGS = {"--xla_cpu_multi_thread_eigen": "false"}

_given = os.environ.get("XLA_FLAGS", "")
_added = (f"{name}={value}" for name, value in _FLAGS.items() if name not in _given)
os.environ["XLA_FLAGS"] = " ".join([_given, *_added]).strip()

import jax  # noqa: E402  (the flags must be set before)
import jax.numpy as jnp  # noqa: E402
from filelock import FileLock  # noqa: E402
from jax.experimental.compilation_cache.compilation_cache import reset_cache  # noqa: E402
from jax.experimental.serialize_executable import deserialize_and_load, serialize  # noqa: E402

# In single precision a gradient solver claims success with a wrong answer on a third of the
# NIST StRD problems; in double precision on none, one true local minimum apart.
jax.config.update("jax_enable_x64", True)

PACKAGES = (
    "adhesion-jax",
    "jax",
    "jaxlib",
    "jaxopt",
    "optimistix",
    "equinox",
    "numpy",
    "scipy",
    "pandas",
)


@contextmanager
def compilation_folder() -> Iterator[str]:
    """Where this process and its workers leave what they compile: a passing folder, if none yet."""
    shared: str | None = jax.config.values["jax_compilation_cache_dir"]
    if shared is not None:
        yield shared
        return
    with TemporaryDirectory() as folder:
        share_compilations(folder)
        try:
            yield folder
        finally:
            jax.config.update("jax_compilation_cache_dir", None)
            reset_cache()


def share_compilations(folder: str) -> None:
    """Let this process take what another has compiled, and leave its own, in `folder`."""
    jax.config.update("jax_compilation_cache_dir", folder)
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)


def threads() -> ThreadPoolExecutor:
    """A thread for each core, for compiled programs that may run at once in one process.

    A program may if it calls LAPACK at most on small matrices: two that factorise stacks of large
    ones deadlock. Measured with jax 0.10 on two cores: loops that call cholesky, solve, inv or eigh
    on 28 matrices of 120 x 120 stood still within the first three calls, by 2 and by 4 threads, in
    all of 7 trials. Loops without LAPACK, on stacks of 28 matrices up to 60 x 60, or on one matrix
    of 72 x 72 did not in 144,000 calls, which the threads shared.
    """
    return ThreadPoolExecutor(CORES)


def cores_for(workers: int, context: BaseContext) -> Queue:
    """The core that each worker is to keep to, for `take_core`; none where that is not possible."""
    cores = context.Queue()
    if hasattr(os, "sched_getaffinity"):
        for _, core in zip(range(workers), cycle(sorted(os.sched_getaffinity(0))), strict=False):
            cores.put(core)
    return cores


def take_core(cores: Queue) -> None:
    """Keep this process to a core of its own: processes that share all of them wait for threads.

    To be called before jax opens a device, which then starts as many threads as there are cores.
    """
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {cores.get()})


def shared_program(name: bytes, make: Callable[[], jax.stages.Compiled]) -> jax.stages.Compiled:
    """The program of that name: from the folder of `share_compilations`, else made and left there.

    Where another process is making it just now, it is waited for.
    """
    folder: str | None = jax.config.values["jax_compilation_cache_dir"]
    if folder is None:
        return make()
    path = Path(folder) / f"{sha256(name).hexdigest()}.program"
    with FileLock(f"{path}.lock"):
        if path.exists():
            # A program that is loaded calls LAPACK where it was found when one was traced: without
            # that it calls address zero.
            jax.jit(jnp.linalg.cholesky).trace(jnp.eye(2)).lower()
            return deserialize_and_load(*pickle.loads(path.read_bytes()))
        program = make()
        path.write_bytes(pickle.dumps(serialize(program)))
    return program


def describe() -> dict[str, object]:
    """Versions, devices and flags of this process, for the metadata of a result."""
    return {
        "python": platform.python_version(),
        "versions": {name: version(name) for name in PACKAGES},
        "devices": [str(device) for device in jax.devices()],
        "machine": platform.machine(),
        "cores": CORES,
        "xla_flags": os.environ["XLA_FLAGS"],
        "precision": "float64",
    }
