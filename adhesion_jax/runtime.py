"""How jax is started for a command, what the package needs as a library, and its threads."""

import os
import platform
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, nullcontext
from functools import cache, wraps
from importlib.metadata import version
from itertools import cycle
from typing import Any, ParamSpec, TypeVar

import jax
import numpy as np
from jaxlib import xla_client
from threadpoolctl import threadpool_limits

from adhesion_jax.errors import InputError

P = ParamSpec("P")
T = TypeVar("T")

#: Cores this process may use; a campaign starts one worker process on each.
CORES = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1

_CONFIG: Any = jax.config  # which does not declare its settings

# One thread per process: a sum is then taken in the same order whatever the number of cores. And a
# loop of many short steps is compiled as one function (by itself the compiler does so up to 1 kB of
# numbers): calls take longer than the work otherwise, and recursions four times as long.
_FLAGS = {
    "--xla_cpu_multi_thread_eigen": "false",
    "--xla_backend_extra_options": "xla_cpu_small_while_loop_byte_threshold=100000000",
}

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


def start() -> None:
    """Set the flags, the precision and the processor of commands, their workers and the tests.

    They compute on the CPU, also where jax finds a GPU: a run has the same numbers everywhere, and
    workers would each claim most of the memory of a GPU.

    Call it before jax opens a device, which takes the flags of that moment; `describe` returns
    the flags in force. Importing the package sets nothing: a program that uses it as a library
    keeps its own flags, and its own precision where it does not ask for another.
    """
    given = os.environ.get("XLA_FLAGS", "")
    added = (f"{name}={value}" for name, value in _FLAGS.items() if name not in given)
    os.environ["XLA_FLAGS"] = " ".join([given, *added]).strip()
    os.environ["MPLBACKEND"] = "agg"  # figures are files, whatever shows them elsewhere
    jax.config.update("jax_enable_x64", True)
    # Set for a search for errors in another program, these let no compiled program run.
    jax.config.update("jax_disable_jit", False)
    jax.config.update("jax_transfer_guard", "allow")
    jax.config.update("jax_platforms", "cpu")
    # Where jax has opened its devices before, it has all of them.
    jax.config.update("jax_default_device", "cpu")


def as_in_commands(function: Callable[P, T]) -> Callable[P, T]:
    """The function with double precision, on the CPU, whatever the program around it has.

    Linear algebra and trees have one thread: the matrices are small, and threads that wait for each
    other take most of the time where other processes work beside them (an identification of 2,400
    points 4.3 CPU-seconds with two threads, 1.1 with one).

    In single precision a gradient solver claims success with a wrong answer on a third of the
    NIST StRD problems; in double precision on none, one true local minimum apart. InputError where
    jax leaves out the CPU.
    """

    @wraps(function)
    def scoped(*args: P.args, **kwargs: P.kwargs) -> T:
        with jax.enable_x64(True), _on_the_cpu(), threadpool_limits(limits=1):
            return function(*args, **kwargs)

    return scoped


def _on_the_cpu() -> AbstractContextManager[None]:
    try:
        cpu = jax.local_devices(backend="cpu")[0]
        there = device() == cpu
    except (RuntimeError, AssertionError) as error:  # jax asserts that it has what it is set to
        chosen = _CONFIG.jax_platforms or "all that it finds"
        raise InputError(
            "This package computes on the CPU, and jax, which is set to compute on "
            f"{chosen}, has none; set JAX_PLATFORMS to cpu, or to cuda,cpu."
        ) from error
    return nullcontext() if there else jax.default_device(cpu)


def device() -> jax.Device:
    """What jax computes on in this thread, unless told otherwise."""
    chosen = _CONFIG.jax_default_device
    if isinstance(chosen, jax.Device):
        return chosen
    return jax.local_devices(backend=chosen)[0]  # of the platform that is named, or of the first


@cache
def calling_thread() -> jax.Device:
    """The CPU, as a device whose programs run in the thread that calls them.

    The one of jax hands a program of a thousand operations or more to another thread, which takes
    13 microseconds at least, and 40 where the processor has other work. Its setting
    jax_cpu_enable_async_dispatch ends that for a whole process, if it comes before all else.
    """
    client: Any = xla_client.make_cpu_client(asynchronous=False)  # of which jaxlib declares nothing
    first: jax.Device = client.local_devices()[0]
    return first


def is_double() -> bool:
    """Whether jax computes in double precision, in this thread."""
    return bool(jax.dtypes.canonicalize_dtype(np.float64) == np.float64)


def require_double_precision() -> None:
    """Raises InputError if jax would compute in single precision."""
    if not is_double():
        raise InputError(
            "Identification needs double precision, and jax is set to single: call "
            'jax.config.update("jax_enable_x64", True) at the start of the program, or work within '
            "`with jax.enable_x64(True):`."
        )


def threads() -> ThreadPoolExecutor:
    """A thread for each core, for compiled programs that may run at once in one process.

    A program may if it calls LAPACK at most on small matrices: two that factorise stacks of large
    ones deadlock. Measured with jax 0.10 on two cores: loops that call cholesky, solve, inv or eigh
    on 28 matrices of 120 x 120 stood still within the first three calls, by 2 and by 4 threads, in
    all of 7 trials. Loops without LAPACK, on stacks of 28 matrices up to 60 x 60, or on one matrix
    of 72 x 72 did not in 144,000 calls, which the threads shared.
    """
    precise, chosen = is_double(), _CONFIG.jax_default_device

    def begin() -> None:
        # A new thread has the settings of the program, not those of the thread that starts it.
        jax.enable_x64(precise).__enter__()
        jax.default_device(chosen).__enter__()

    return ThreadPoolExecutor(CORES, initializer=begin)


def silent(*_: object) -> None:
    """Reports no progress."""


def cores_of(workers: int) -> list[int | None]:
    """The core that each worker is to keep to, for `take_core`; None where that is not possible."""
    if not hasattr(os, "sched_getaffinity"):
        return [None] * workers
    cores = cycle(sorted(os.sched_getaffinity(0)))
    return [next(cores) for _ in range(workers)]


def take_core(core: int | None) -> None:
    """Keep this process to a core of its own: processes that share all of them wait for threads.

    Call it before jax opens a device, which then starts one thread per core.
    """
    if core is not None:
        os.sched_setaffinity(0, {core})


def describe() -> dict[str, object]:
    """Versions, devices and flags of this process, for the metadata of a result."""
    return {
        "python": platform.python_version(),
        "versions": {name: version(name) for name in PACKAGES},
        "devices": [str(device())],
        "machine": platform.machine(),
        "cores": CORES,
        "xla_flags": os.environ.get("XLA_FLAGS", ""),
        "precision": "float64",
    }
