"""How every command speaks: options, one sentence for what cannot be used, and a record."""

import errno
import json
import math
import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import click
from click.shell_completion import CompletionItem
from tqdm import tqdm

from adhesion_jax.errors import InputError, WorkerError, cannot_write
from adhesion_jax.options import MOST_RUNS, Option
from adhesion_jax.plugins import Part, part, use, worded
from adhesion_jax.wording import listed

#: Where a click context holds the arguments of a recorded command, as they were given.
_ARGUMENTS = f"{__name__}.arguments"

#: Most folders within each other that results may lie in.
_DEEPEST = 200

#: What a standard output is refused with.
_OF_STREAMS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EBADF)

#: Seeds of noise are numbers of 32 bits.
SEED = click.IntRange(min=0, max=2**32 - 1)


def run(command: click.Command) -> None:
    """Run a command to the end of the process: status 0, or one sentence and status 2.

    That is also for an error that a part of the user's own led to. Status 1 where the machine
    failed: a worker process that died, or a standard output that takes no more.
    """
    _open_streams()
    try:
        worded(partial(command.main, standalone_mode=False))
    except click.Abort:
        sys.exit(130)
    except click.ClickException as error:
        _refuse(error.format_message())
    except InputError as error:
        _refuse(str(error))
    except WorkerError as error:
        click.echo(f"error: {error}", err=True)
        sys.exit(1)
    except OSError as error:
        if error.filename is not None or error.errno not in _OF_STREAMS:
            raise
        sys.stdout = None  # it is not tried once more at the end
        click.echo(f"error: the output cannot be written ({error.strerror}).", err=True)
        sys.exit(1)


def _open_streams() -> None:
    """Open the standard streams that are closed: the next file would take the place of one."""
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # which takes the lowest number that is free
    sys.stdout = sys.stdout or os.fdopen(1, "w", closefd=False)
    sys.stderr = sys.stderr or os.fdopen(2, "w", closefd=False)


def _refuse(sentence: str) -> None:
    click.echo(f"error: {sentence}", err=True)
    sys.exit(2)


def start() -> None:
    """Import jax and set what commands run with."""
    from adhesion_jax import programs, runtime

    runtime.start()
    programs.share_with_jax()


class Recorded(click.Command):
    """A command whose arguments are recorded beside its results.

    An option that takes one value is given once: of two click would take the last in silence.
    """

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        ctx.meta[_ARGUMENTS] = list(args)
        if not ctx.resilient_parsing:
            _, _, given = self.make_parser(ctx).parse_args(list(args))
            for one in given:
                if given.count(one) > 1 and isinstance(one, click.Option) and not one.multiple:
                    commas = "; divide its values by commas" if isinstance(one.type, Names) else ""
                    raise InputError(f"{one.opts[0]} is given more than once{commas}.")
        return super().parse_args(ctx, args)


def begin(*asked: Any) -> tuple[Any, ...]:
    """Import jax, and put parts of the user's own that are asked for into their registries.

    What is asked for is returned with their names. Call it before the rooms are imported, for some
    of them make tables of the registries.
    """
    start()
    return tuple(map(_by_name, asked))


def _by_name(value: object) -> object:
    if isinstance(value, Part):
        return use(value)
    return tuple(map(_by_name, value)) if isinstance(value, tuple) else value


class FiniteRange(click.FloatRange):
    """A number in a range; nan and infinity, which pass every comparison or none, are refused."""

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        number: float = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return number


def number_in(option: Option) -> FiniteRange:
    """A number in the range of an option."""
    return FiniteRange(option.low, option.high, option.low_open, option.high_open)


class Folder(click.Path):
    """A folder to write into; an empty name, which pathlib takes for this folder, is refused.

    It is made when there is something to write. Where that cannot succeed it is refused before.
    """

    name = "folder"

    def __init__(self) -> None:
        super().__init__(path_type=Path)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if value == "":
            self.fail("the name is empty; name a folder, or . for this one.", param, ctx)
        path = Path(str(super().convert(value, param, ctx)))
        try:
            os.stat(path)
            reason = ""
        except (OSError, ValueError) as error:  # a name that is too long, or holds a zero
            known = isinstance(error, (FileNotFoundError, NotADirectoryError, PermissionError))
            reason = "" if known else getattr(error, "strerror", None) or "it is no name of a file"
        if len(path.parts) > _DEEPEST:
            reason = "it lies too deep"
        if not reason:
            there = next(place for place in (path, *path.absolute().parents) if _exists(place))
            if not there.is_dir() or not os.access(there, os.W_OK):
                reason = "Permission denied" if there.is_dir() else f"{there} is a file"
        if reason:
            raise cannot_write(path, reason)
        return path


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except OSError:  # within a folder that may not be seen
        return False


class Cluster(click.ParamType):
    """A Dask cluster: `local:N`, or the address of a scheduler."""

    name = "cluster"

    def convert(self, value: str, param: Any, ctx: Any) -> str:
        local = re.fullmatch(r"local:0*[1-9]\d{0,3}", value)
        remote = re.fullmatch(r"(tcp|tls)://[^\s/]+:(\d{1,5})", value)
        if not local and not (remote and 0 < int(remote[2]) < 2**16):
            raise InputError(
                f"--cluster {value} is no cluster; give local:N for N workers on this machine, or "
                "the address of a scheduler as tcp://HOST:PORT."
            )
        return value


def command(
    *examples: str, cls: type[click.Command] = Recorded
) -> Callable[[Callable[..., None]], click.Command]:
    """A decorator that makes a command, whose name the examples under its help begin with."""
    epilog = "\b\nExamples:\n" + "\n".join(f"  adhesion {line}" for line in examples)
    return click.command(cls=cls, epilog=epilog, context_settings={"show_default": True})


def out_folder(name: str, files: str = "") -> Callable[[Callable[..., None]], Callable[..., None]]:
    """A decorator that gives a command the folder `out`, by default of this name, for its files."""
    words = f"Folder for {files}." if files else None
    return click.option("--out", type=Folder(), default=Path("out", name), help=words)


def in_shards(command: Callable[..., None]) -> Callable[..., None]:
    """A decorator that gives a command what is asked of a job in shards, and where it computes."""
    cluster = click.option(
        "--cluster",
        type=Cluster(),
        help="Compute on Dask workers: local:N starts N here, tcp://HOST:PORT joins a scheduler.",
    )
    workers = click.option(
        "--workers",
        type=click.IntRange(min=1),
        help="Processes (one for each core); the results do not depend on their number.",
    )
    extend = click.option(
        "--extend",
        type=click.IntRange(0, MOST_RUNS),
        default=0,
        help="Number of runs to add to the job in the folder, however many it has.",
    )
    resume = click.option(
        "--resume", is_flag=True, help="Compute what an interrupted job left over."
    )
    return resume(extend(workers(cluster(command))))


class File(click.ParamType):
    """A file to read, which must be there; or a name that stands for one."""

    name = "file"

    def __init__(self, names: Sequence[str] = (), wanted: str = "") -> None:
        self.names, self.wanted = names, wanted

    def convert(self, value: str, param: Any, ctx: Any) -> str:
        try:
            if value not in self.names and not Path(value).is_file():
                problem = "is not a file" if Path(value).exists() else "does not exist"
                raise InputError(f"{value} {problem}; {self.wanted}.")
        except (OSError, ValueError) as error:  # a name that is too long, or holds a zero
            if isinstance(error, InputError):
                raise
            reason = getattr(error, "strerror", None) or "it is no name of a file"
            raise InputError(f"{value} cannot be read ({reason}); {self.wanted}.") from None
        return value

    def shell_complete(self, ctx: Any, param: Any, incomplete: str) -> list[CompletionItem]:
        return [*_starting(self.names, incomplete), CompletionItem(incomplete, type="file")]


class Name(click.ParamType):
    """One of the names of the package or, where a kind is given, a part FILE.py:NAME."""

    name = "name"

    def __init__(self, names: Iterable[str], kind: str = "") -> None:
        self.names, self.kind = tuple(names), kind

    def convert(self, value: Any, param: Any, ctx: Any) -> Any:
        if value in self.names or isinstance(value, Part):
            return value
        own = part(self.kind, value) if self.kind else None
        if own is None:
            names = [*filter(None, self.names), *(["FILE.py:NAME"] if self.kind else [])]
            raise InputError(
                f"{param.opts[0]} {value} is not known; name one of {listed(names, 'or')}."
            )
        return own

    def shell_complete(self, ctx: Any, param: Any, incomplete: str) -> list[CompletionItem]:
        return _starting(self.names, incomplete)


class Names(Name):
    """The same divided by commas, as a tuple."""

    name = "names"

    def convert(self, value: Any, param: Any, ctx: Any) -> Any:
        if isinstance(value, tuple):
            return value
        named = tuple(
            super(Names, self).convert(name.strip(), param, ctx) for name in value.split(",")
        )
        own: dict[str, Part] = {}
        for one in named:
            if isinstance(one, Part) and own.setdefault(one.name, one).source != one.source:
                raise InputError(f"{own[one.name]} and {one} have one name; rename one of them.")
        return named

    def shell_complete(self, ctx: Any, param: Any, incomplete: str) -> list[CompletionItem]:
        before, comma, begun = incomplete.rpartition(",")
        return [CompletionItem(before + comma + one.value) for one in _starting(self.names, begun)]


def _starting(names: Iterable[str], begun: str) -> list[CompletionItem]:
    return [CompletionItem(name) for name in names if name.startswith(begun)]


def listing(**kinds: Iterable[str]) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """A decorator that gives a command the option; names may be mapped to words about them."""

    def tell(context: click.Context, _: click.Parameter, wanted: bool) -> None:
        if not wanted or context.resilient_parsing:
            return
        for kind, names in kinds.items():
            told = names if isinstance(names, Mapping) else dict.fromkeys(names, "")
            width = max(map(len, told))
            click.echo(kind)
            for name, words in told.items():
                click.echo(f"  {name:<{width}}  {words}".rstrip())
        context.exit()

    return click.option(
        "--list",
        is_flag=True,
        is_eager=True,
        expose_value=False,
        callback=tell,
        help="Show the names that the options know.",
    )


_BAR = "{desc} {percentage:3.0f} %|{bar}| {elapsed}<{remaining}"


@contextmanager
def shown(words: str = "") -> Iterator[Callable[[str, float], None]]:
    """A function of words and the share that is done, which shows both while it is called.

    Nothing is shown where the standard error is not a terminal.
    """
    with tqdm(total=100, desc=words, bar_format=_BAR, leave=False, disable=None) as bar:

        def progress(words: str, share: float) -> None:
            bar.set_description_str(words)
            bar.update(100 * share - bar.n)

        yield progress


#: The commands that write results.
RECORDED = ("montecarlo", "identify", "track", "discover", "simulate", "plan", "traction")


def record(folder: Path) -> None:
    """Write metadata.json: what was asked, versions and machine.

    What a result has written there before, as how columns were understood, stays, but for the call
    of the function that made it.
    """
    from adhesion_jax import runtime
    from adhesion_jax.files import METADATA, staged, write_metadata

    path = folder / METADATA
    told = json.loads(path.read_text(encoding="utf-8")) if path.exists() else runtime.describe()
    told.pop("call", None)
    with staged(folder, [METADATA]) as stage:
        write_metadata(stage / METADATA, {**_asked(), **told})


def written(found: object, folder: Path, seconds: float | None = None) -> None:
    """Record what was asked, and print the result and where its files are."""
    record(folder)
    took = "" if seconds is None else f" in {seconds:.0f} s"
    click.echo(f"{found}\n\nWritten to {folder}{took}")


def _asked() -> Mapping[str, object]:
    """The command, its arguments, from where, and what all options came to, as JSON has it."""
    context = click.get_current_context()
    assert context.command.callback is not None
    options = {
        param.opts[0]: _plain(context.params[param.name])
        for param in context.command.get_params(context)
        if param.name in context.params
    }
    return {
        "command": context.command.callback.__module__.rpartition(".")[-1],
        "arguments": context.meta[_ARGUMENTS],
        "folder": os.getcwd(),
        "options": options,
    }


def _plain(value: object) -> object:
    if isinstance(value, (list, tuple)) and not isinstance(value, Part):
        return [_plain(one) for one in value]
    return value if value is None or isinstance(value, (bool, int, float, str)) else str(value)
