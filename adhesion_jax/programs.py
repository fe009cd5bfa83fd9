"""Compiled programs, kept from one process to the next, and never older than their source.

A program is known by the content of all that it is made from (`digest`), and lies in the folder of
`keeping`.
"""

import os
import pickle
import platform
import sys
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from functools import cache, wraps
from hashlib import sha256
from importlib.metadata import version
from io import BytesIO
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple
from uuid import uuid4

import jax
import jax.numpy as jnp
from filelock import FileLock
from jax.experimental.serialize_executable import deserialize_and_load, serialize

from adhesion_jax import keeping
from adhesion_jax.keeping import folder, is_outside, of_outside, of_package
from adhesion_jax.runtime import device, is_double

#: Largest number of bytes of the kept programs, and again of the small ones that jax keeps.
MOST_BYTES = 2**29

_LIBRARIES = ("jax", "jaxlib", "equinox", "jaxopt", "lineax", "numpy", "optimistix")

_OF_DEVICES = ("jax_platforms", "jax_default_device")

_Kind = tuple[tuple[int, ...], Any, bool]
_Options = Mapping[str, str | bool]

NO_OPTIONS: _Options = MappingProxyType({})

#: For programs that take longer to compile than to run: two thirds of the time to compile.
QUICKLY: _Options = MappingProxyType({"xla_cpu_use_fusion_emitters": False})

#: For loops of many numbers side by side: vectors of 512 bits where the processor has them, of
#: which the compiler by itself uses a half. Steps of a plant take .7 times as long.
WIDELY: _Options = MappingProxyType({"xla_cpu_prefer_vector_width": "512"})


def digest() -> str:
    """All that a program depends on beside its arguments, in a number of fixed length.

    The source of the package and of what was loaded from outside, versions, flags, the settings of
    jax, and the kinds of the processor and of the device that jax computes on.
    """
    content = sha256(_of_machine().encode())
    content.update(os.environ.get("XLA_FLAGS", "").encode())
    content.update(repr(sorted(_settings())).encode())
    content.update(of_outside().encode())
    return content.hexdigest()


@cache
def _of_machine() -> str:
    """Source of the package, versions and processor, which do not change while a process runs."""
    content = sha256(of_package().encode())
    versions = [f"{name} {version(name)}" for name in _LIBRARIES]
    content.update(repr((platform.python_version(), versions, processor())).encode())
    return content.hexdigest()


def processor() -> str:
    """The processor's name and features: a program compiled for another one may not run here."""
    told = Path("/proc/cpuinfo")
    if not told.exists():
        return f"{platform.machine()} {platform.processor()}"
    lines = told.read_text(encoding="utf-8", errors="replace").split("\n\n")[0].splitlines()
    names = ("model name", "flags", "Features", "CPU part")
    return "\n".join(line for line in lines if line.startswith(names))


def _settings() -> Iterable[tuple[str, str]]:
    """The settings of jax, but for those of its own cache and its log, in this thread.

    The settings that choose a device are told by what they lead to.
    """
    for name, value in jax.config.values.items():
        if "cache" not in name and "log" not in name and name not in _OF_DEVICES:
            yield name, repr(value)
    yield "jax_enable_x64", repr(is_double())
    yield "device", device().device_kind


def share_with_jax() -> None:
    """Let jax keep its small programs, which it knows by their content, in the same folder.

    Where the user has named a folder to jax, that one stays.
    """
    if jax.config.values["jax_compilation_cache_dir"] is None:
        own = folder() / f"jax-{sha256(processor().encode()).hexdigest()[:16]}"
        jax.config.update("jax_compilation_cache_dir", str(own))
        jax.config.update("jax_compilation_cache_max_size", MOST_BYTES)
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
        jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)


def program(
    name: object, function: Callable[[Any], Any], argument: Any, compiler: _Options = NO_OPTIONS
) -> jax.stages.Compiled:
    """The compiled function of one argument, or of one like it: taken from the folder, or made.

    `name` says, with the present `digest`, which function it is. Where another process is making
    the program just now, it is waited for. A name that does not tell its content (with a local
    function in it, or a class of a program that uses this one as a library) belongs to a program
    that is made anew in every process. One with a part from outside is traced in every process and
    known by what that gives too: such a part may read a file, and its source does not tell of it.
    """
    stable = stable_key(name)
    if stable is None:
        return _made(function, argument, compiler)
    content = digest().encode() + stable.content
    if stable.outside:
        content += jax.jit(function).lower(argument).as_text().encode()
    key = sha256(content).hexdigest()
    path = folder() / f"{key}.program"
    with FileLock(folder() / "locks" / f"{key[:3]}.lock"):
        found = _loaded(path)
        if found is None:
            # What jax takes from its own cache cannot be kept once more: it would lack parts when
            # it is loaded ("Function ... not found", jax 0.10). No other program has this name.
            def anew(argument: Any) -> Any:
                return function(argument)

            anew.__name__ = f"{function.__name__}_{uuid4().hex}"
            found = _made(anew, argument, compiler)
            _keep(path, found)
    return found


def _made(function: Callable[[Any], Any], argument: Any, compiler: _Options) -> jax.stages.Compiled:
    lowered = jax.jit(function).lower(argument)
    known = {name: value for name, value in compiler.items() if _is_option(name, value)}
    # In vectors of 512 bits the fusion emitters give 0 for seven of eight arctangents (jaxlib
    # 0.10.2).
    if not QUICKLY.items() <= known.items() and "atan" in lowered.as_text():
        known = {name: value for name, value in known.items() if name not in WIDELY}
    return lowered.compile(known)


@cache
def _is_option(name: str, value: str | bool) -> bool:
    """Whether the compiler that is installed has it: options change the time, never a result."""
    try:
        jax.jit(jnp.sin).lower(0.0).compile({name: value})
    except jax.errors.JaxRuntimeError:
        return False
    return True


class _StablePickler(pickle.Pickler):
    """Pickles classes and functions by their names: `digest` depends on their source."""

    outside = False  # whether one of them is from outside the package

    def persistent_id(self, value: object) -> None:
        module = getattr(value, "__module__", None)
        if not isinstance(module, str) or _is_installed(module):
            return
        file = getattr(sys.modules.get(module), "__file__", None) or ""
        if not is_outside(file, f"{module}.py"):
            # A change of a user's own module does not change `digest`.
            raise pickle.PicklingError(f"{module} may change while its names stay")
        self.outside = True


def _is_installed(module: str) -> bool:
    package = module.partition(".")[0]
    return package in sys.stdlib_module_names or package in ("adhesion_jax", *_LIBRARIES)


class StableKey(NamedTuple):
    """A key in bytes that are the same in every process."""

    content: bytes
    outside: bool  # whether it names a part from outside the package


def stable_key(name: object) -> StableKey | None:
    """A deterministic pickle of the key; None if it refers to code outside the digest."""
    stream = BytesIO()
    pickler = _StablePickler(stream)
    pickler.fast = True  # equal names give equal bytes, whichever of their parts are one object
    try:
        pickler.dump(name)
    except (pickle.PicklingError, AttributeError, TypeError):
        return None
    return StableKey(stream.getvalue(), pickler.outside)


def _loaded(path: Path) -> jax.stages.Compiled | None:
    """The program that lies there whole; None where there is none, or a damaged one."""
    payload = keeping.kept(path)
    if payload is None:
        return None
    # A program that is loaded calls LAPACK where it was found when one was traced: without
    # that it calls address zero.
    _find_lapack()
    try:
        chosen = device()
        content, inputs, outputs = pickle.loads(payload)
        found = deserialize_and_load(
            content, inputs, outputs, backend=chosen.client, execution_devices=[chosen]
        )
        os.utime(path)  # the time of its last use
    except Exception:  # whatever the error, the program can be made again
        return None
    return found


@cache
def _find_lapack() -> None:
    traced = jax.jit(jnp.linalg.cholesky).trace(jax.ShapeDtypeStruct((2, 2), jnp.float32))
    traced.lower(lowering_platforms=("cpu",))


def _keep(path: Path, made: jax.stages.Compiled) -> None:
    try:
        payload = pickle.dumps(serialize(made))
        form = pickle.loads(pickle.dumps(made.out_tree))
    except (ValueError, NotImplementedError, pickle.PicklingError, AttributeError, TypeError):
        return  # one that calls Python, or a backend that cannot: each process compiles its own
    if form != made.out_tree:
        return  # its result would not be found again: modules mark what they lack by an object
    keeping.keep(path, payload)
    with suppress(OSError):
        _bound(path.parent)


def _bound(where: Path) -> None:
    """Remove the programs whose last use is longest ago until the others have room."""
    used = []
    for path in where.glob("*.program"):
        try:
            status = path.stat()
        except FileNotFoundError:  # removed by another process
            continue
        used.append((status.st_mtime, status.st_size, path))
    total = 0
    for _, size, path in sorted(used, reverse=True):
        total += size
        if total > MOST_BYTES:
            path.unlink(missing_ok=True)


class Timed(NamedTuple):
    """What a program gave, and what it took."""

    result: Any
    seconds: float  # CPU time, without compilation
    compile_seconds: float  # wall-clock time to compile or load it


class Kept:
    """A function of a module, compiled as by `jax.jit`, whose programs are kept.

    Its arguments are given by position; `static` are the places of those that are no arrays.
    `reads` says which parts a program is made of that are no arguments, such as those of a
    registry: where they are others than before, another program is made.
    Inside another program it is a part of that one, and arrays that were put on another device are
    followed there, as with `jax.jit`.
    """

    def __init__(
        self,
        function: Callable[..., Any],
        compiler: _Options,
        static: tuple[int, ...],
        reads: Callable[[], tuple[object, ...]],
    ) -> None:
        self.function, self.options, self.static = function, dict(compiler), static
        self.reads = reads
        self.jitted = jax.jit(function, static_argnums=static)
        #: With what they read, which stays alive, so that no other object has its identity.
        self.programs: dict[object, tuple[Callable[..., Any], object]] = {}

    def __call__(self, *arguments: Any) -> Any:
        leaves = jax.tree.leaves(self._arrays(arguments))
        if any(isinstance(leaf, jax.core.Tracer) or _is_elsewhere(leaf) for leaf in leaves):
            return self.jitted(*arguments)
        return self.ready(*arguments)(leaves)

    def timed(self, *arguments: Any) -> Timed:
        """The function of the arguments, computed when its program is there."""
        began = time.perf_counter()
        program = self.ready(*arguments)
        compile_seconds = time.perf_counter() - began
        leaves = jax.tree.leaves(self._arrays(arguments))
        began = time.process_time()
        found = jax.block_until_ready(program(leaves))
        seconds = time.process_time() - began
        return Timed(found, seconds, compile_seconds)

    def ready(self, *arguments: Any) -> Callable[[list[Any]], Any]:
        """The program for arguments like these, of the leaves of those that are arrays."""
        leaves, form = jax.tree.flatten(self._arrays(arguments))
        kinds = tuple(map(_kind, leaves))
        fixed = tuple(arguments[place] for place in self.static)
        read = self.reads()
        known = (form, kinds, fixed, is_double(), device(), of_outside(), *map(id, read))
        if known not in self.programs:

            def of_leaves(leaves: list[Any]) -> Any:
                given = list(jax.tree.unflatten(form, leaves))
                for place, value in zip(self.static, fixed, strict=True):
                    given[place] = value
                return self.function(*given)

            shapes = [jax.ShapeDtypeStruct(s, d, weak_type=w) for s, d, w in kinds]
            whose = (self.function.__module__, self.function.__qualname__, self.options)
            name = (whose, form, str(kinds), fixed, read)
            self.programs[known] = program(name, of_leaves, shapes, self.options), read
        return self.programs[known][0]

    def _arrays(self, arguments: tuple[Any, ...]) -> tuple[Any, ...]:
        return tuple(None if i in self.static else one for i, one in enumerate(arguments))


def kept(
    *,
    compiler: _Options = QUICKLY,
    static: tuple[int, ...] = (),
    reads: Callable[[], tuple[object, ...]] = tuple,
) -> Any:
    """A decorator that makes a function of a module one whose programs are kept (`Kept`)."""
    return lambda function: wraps(function)(Kept(function, compiler, static, reads))


def _is_elsewhere(leaf: Any) -> bool:
    return getattr(leaf, "committed", False) and leaf.devices() != {device()}


def _kind(leaf: Any) -> _Kind:
    kind = jax.typeof(leaf)
    return kind.shape, kind.dtype, kind.weak_type
