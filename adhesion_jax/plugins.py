"""Parts in files of the user's own: FILE.py:NAME in the place of a name of the package.

A part is put into the registry of its kind under NAME for as long as the process lives. Numbers
depend on NAME and on the content of the file, not on where it lies. The rooms are named here as
text, for only that of the part is imported, and reading a file needs none.
"""

import inspect
import re
import sys
from collections.abc import Callable, Collection, Mapping
from functools import wraps
from hashlib import sha256
from importlib import import_module
from pathlib import Path
from traceback import walk_tb
from types import ModuleType
from typing import Any, NamedTuple, TypeVar

from adhesion_jax import keeping
from adhesion_jax.errors import InputError
from adhesion_jax.options import declared
from adhesion_jax.wording import listed

T = TypeVar("T")


class Part(NamedTuple):
    """A part as it was asked for, with what stood in its file then."""

    kind: str
    path: str
    name: str
    source: bytes

    def __str__(self) -> str:
        return f"{self.path}:{self.name}"


#: What is said where a part calls NumPy with what jax traces.
_TRACED = (
    "; what jax traces is computed by jax.numpy. NumPy and SciPy are called through "
    "jax.pure_callback; as a method, a function of slip and adhesion that they compute, or a "
    "class that is not derived from Identifier, can be named"
)


class Kind(NamedTuple):
    """What a part may be: an article and a noun, its room, its class there, what is made of it."""

    what: str
    room: str
    base: str
    made: Callable[[str, Any, "Kind"], Any]

    @property
    def home(self) -> str:
        """The class of such parts, as a user imports it."""
        return f"adhesion_jax.{self.room}.{self.base}"

    @property
    def registry(self) -> str:
        """The mapping that has them by name."""
        return f"adhesion_jax.{self.room}.{self.room.rpartition('.')[2].upper()}"


#: The parts of files that were put into a registry, by kind and name.
_used: dict[tuple[str, str], Part] = {}

#: Kinds and names of all parts of the user's own.
_own: set[tuple[str, str]] = set()


def part(kind: str, text: str) -> Part | None:
    """The part that FILE.py:NAME names, read but not run; None where the text is no such name.

    InputError where there is no such file, or where it is no Python.
    """
    found = re.fullmatch(r"(.+\.py)(?::(\w*))?", text)
    if found is None:
        return None
    path, name = found.groups()
    if not name:
        raise InputError(f"{path} is a file; name the part in it too, as {path}:NAME.")
    try:
        if Path(path).exists() and not Path(path).is_file():
            raise InputError(f"{path} is not a file; name one of Python.")
        source = Path(path).read_bytes()
        compile(source, path, "exec")
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}); name another file.") from None
    except SyntaxError as error:
        raise InputError(f"{path} is no Python in line {error.lineno}: {error.msg}.") from None
    except (ValueError, RecursionError, MemoryError) as error:
        raise InputError(f"{path} is no Python: {error}.") from None
    return Part(kind, str(Path(path).absolute()), name, source)


def use(asked: Part) -> str:
    """Run the file, put the part into the registry of its kind, and return its name there."""
    before = _used.get((asked.kind, asked.name))
    if before is not None and before.source == asked.source:
        return asked.name
    module = _module(asked)
    if not hasattr(module, asked.name):
        names = [name for name, value in vars(module).items() if _of(module, name, value)]
        has = f"it has {listed(names)}" if names else "it defines nothing"
        raise InputError(f"{asked.path} has no {asked.name}; {has}.")
    _put(asked.kind, asked.name, getattr(module, asked.name), str(asked))
    _used[asked.kind, asked.name] = asked
    return asked.name


def add(kind: str, own: Mapping[str, object]) -> None:
    """Put parts into the registry of their kind, in the place of earlier ones of the user's own.

    InputError where one is none of the kind, or has the name of a part of the package.
    """
    for name, found in own.items():
        _put(kind, name, found, name)


def _put(kind: str, name: str, found: object, told: str) -> None:
    own, registry = made(kind, told, found), _named(KINDS[kind].registry)
    if name in registry and (kind, name) not in _own:
        raise InputError(f"{told} has the name of another part; give it a name of its own.")
    registry[name] = own
    _own.add((kind, name))


def made(kind: str, told: str, found: object) -> Any:
    """The part that a class, an object or a function is; InputError where it is none of the kind.

    It is named as `told` there.
    """
    return KINDS[kind].made(told, found, KINDS[kind])


def used() -> tuple[Part, ...]:
    """All parts that are in use, for another process to use."""
    return tuple(_used.values())


def _named(place: str) -> Any:
    module, _, name = place.rpartition(".")
    return getattr(import_module(module), name)


def _module(asked: Part) -> ModuleType:
    """The file as a module with a name by its content, so that what is in it can be pickled."""
    name = f"part_{sha256(asked.source).hexdigest()[:16]}"
    if name in sys.modules:
        return sys.modules[name]
    path = Path(asked.path)
    if str(path.parent) not in sys.path:
        sys.path.append(str(path.parent))  # for what the file imports from beside it
    known = {*sys.modules}
    module = sys.modules[name] = ModuleType(name)
    module.__file__ = asked.path
    try:
        exec(compile(asked.source, asked.path, "exec"), module.__dict__)
    except (Exception, SystemExit) as error:
        del sys.modules[name]
        raise InputError(f"{asked.path} cannot be run, {_fault(error, [asked.path])}.") from None
    keeping.outside(Path(f"{name}.py"), asked.source)
    for other in {*sys.modules} - known - {name}:
        # Programs depend on what a file imports from beside it, too.
        file = Path(getattr(sys.modules[other], "__file__", None) or sys.prefix)
        own = file.is_relative_to(path.parent) and not file.is_relative_to(sys.prefix)
        if own and file.suffix == ".py":
            keeping.outside(file, file.read_bytes())
    return module


def worded(function: Callable[..., T], *arguments: Any) -> T:
    """The function of these arguments; an error that a file of the user's own led to in words.

    That is an InputError with the file and the line. It comes from one process to another, which an
    error of jax does not.
    """
    try:
        return function(*arguments)
    except Exception as error:
        fault = _fault(error, [part.path for part in _used.values()])
        if fault is None or isinstance(error, InputError):
            raise
        traced = any(kind.__name__ == "JAXTypeError" for kind in type(error).__mro__)
        raise InputError(f"{fault}{_TRACED if traced else ''}.") from error


def _fault(error: BaseException, paths: Collection[str]) -> str | None:
    """The last line of one of these files that led to an error, and what the error is."""
    lines = [line for line in walk_tb(error.__traceback__) if line[0].f_code.co_filename in paths]
    if not lines:
        return None
    frame, line = lines[-1]
    words = str(error).strip().partition("\n")[0].rstrip(".")
    return f"{frame.f_code.co_filename}, line {line}: {type(error).__name__}: {words}"


def _of(module: ModuleType, name: str, value: object) -> bool:
    """Whether the file defines it, rather than imports it."""
    of = getattr(value, "__module__", type(value).__module__)
    return of == module.__name__ and not name.startswith("_")


def _class(asked: str, found: Any, kind: Kind) -> Any:
    """The class, if it is one of the kind and lacks nothing."""
    base = _named(kind.home)
    if not (inspect.isclass(found) and issubclass(found, base)):
        raise InputError(f"{asked} is not {kind.what}: derive it from {kind.home}.")
    places = ("__abstractmethods__", "__abstractclassvars__", "__abstractvars__")
    lacking = sorted({name for place in places for name in getattr(found, place, ())})
    if lacking:
        raise InputError(f"{asked} lacks {listed(lacking)}, which {kind.what} must have.")
    return found


def _instance(asked: str, found: Any, kind: Kind) -> Any:
    """The object, if it is one of the kind and lacks nothing, or that of the class."""
    _class(asked, found if inspect.isclass(found) else type(found), kind)
    return object_of(asked, found)


def object_of(asked: str, found: Any) -> Any:
    """The object, or that of the class without arguments; InputError where it needs some."""
    if not inspect.isclass(found):
        return found
    try:
        return found()
    except TypeError as error:
        words = " ".join(str(error).split()).rstrip(".")
        raise InputError(
            f"{asked} cannot be made without arguments ({words}); give its fields values, or name "
            "an object of that class."
        ) from None


def _method(asked: str, found: Any, kind: Kind) -> Any:
    """The same, or the method that a function or a class of NumPy is."""
    form = found if inspect.isclass(found) else type(found)
    of_numpy = any(hasattr(form, name) for name in ("init", "update", "estimate"))
    if inspect.isfunction(found) or (of_numpy and not issubclass(form, _named(kind.home))):
        return _named("adhesion_jax.identifiers.of_numpy.of_numpy")(asked, found)
    return _instance(asked, found, kind)


def _entrant(asked: str, found: Any, kind: Kind) -> Any:
    """What is compared in a leaderboard: the part with the others that all methods share."""
    return _named(f"adhesion_jax.{kind.room}.entrant_of")(asked, found)


def _builder(asked: str, found: Any, kind: Kind) -> Callable[..., Any]:
    """The function, whose arguments become options, and what it builds a scenario."""
    scenario = _named(kind.home)
    if inspect.isclass(found) or not callable(found):
        raise InputError(f"{asked} is not {kind.what}.")
    try:
        declared(found)
    except (StopIteration, NameError, TypeError, ValueError):
        raise InputError(
            f"{asked} has an argument that is not described; annotate it as those in "
            "adhesion_jax.options are."
        ) from None

    @wraps(found)
    def built(**options: Any) -> Any:
        made = found(**options)
        if not isinstance(made, scenario):
            raise InputError(f"{asked} returns {type(made).__name__}, and not a scenario.")
        return made

    return built


KINDS: dict[str, Kind] = {
    "identifier": Kind("an identifier", "identifiers", "Identifier", _method),
    "scenario": Kind("a function that builds a scenario", "scenarios", "Scenario", _builder),
    "curve": Kind("a curve", "curves", "Curve", _instance),
    "effect": Kind("an effect", "effects", "Cause", _class),
    "observer": Kind("an observer", "traction.observers", "Observer", _instance),
    "seeker": Kind("a seeker", "traction.seekers", "Seeker", _instance),
    "controller": Kind("a controller", "traction.controllers", "Controller", _instance),
    "entrant": Kind("a method of slip control", "traction.entrants", "Entrant", _entrant),
}
