"""How every command that reads measurements is told what their columns are, and reads them."""

import glob
import math
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from adhesion_jax.command_line.command import File, FiniteRange, shown
from adhesion_jax.errors import InputError

if TYPE_CHECKING:
    from adhesion_jax.data import Measured
    from adhesion_jax.data.events import Chosen

#: What is said where nothing can be read.
WANTED = "name a file of measurements, or a folder or a pattern of such files"

#: What of sensors and wheelset the columns do not tell, as the functions of the library take it.
CORRECTIONS = ("wheel_radius", "delays", "inertia", "gear_ratio", "efficiency", "axles")

slip_noise = click.option(
    "--slip-noise",
    type=FiniteRange(min=0),
    help="Standard deviation of the noise of the wheel speed in m/s (of slip, where there is no "
    "vehicle speed), 0 for an exact slip; by default it is estimated where there is time_s.",
)

_OPTIONS = (
    click.option(
        "--columns",
        "columns_file",
        type=click.Path(path_type=Path),
        metavar="MAP.TOML",
        help="A file of the same as --column, a line each.",
    ),
    click.option(
        "--column",
        "columns_named",
        multiple=True,
        metavar="QUANTITY=COLUMN [UNIT]",
        help='What a column is, as in "speed=v [km/h]"; or, where there is no such column, a '
        'constant, as in "axle_load=200 kN". May be given often.',
    ),
    click.option(
        "--wheel-radius",
        type=FiniteRange(min=0.05, max=2.0),
        metavar="METRES",
        help="Rolling radius of the wheel, where its rotation was measured; by default it is "
        "identified.",
    ),
    click.option(
        "--delay",
        "delays",
        multiple=True,
        metavar="NAME=SECONDS",
        help="How late a signal is, as in vehicle_speed=0.2; NAME is vehicle_speed, wheel_speed, "
        "force, load or a quantity. May be given often.",
    ),
    click.option(
        "--inertia",
        type=FiniteRange(min=0.0, min_open=True),
        metavar="KG_M2",
        help="Inertia of a wheelset with all that turns with it, which is taken off the force; "
        "needs --wheel-radius.",
    ),
    click.option(
        "--gear-ratio",
        type=FiniteRange(min=0.0, min_open=True),
        metavar="RATIO",
        help="Turns of the motor for one of the wheel, where the torque of the motor was measured; "
        "needs --wheel-radius.",
    ),
    click.option(
        "--efficiency",
        type=FiniteRange(min=0.0, max=1.0, min_open=True),
        metavar="SHARE",
        help="Of the gear between motor and wheel.  [default: 1]",
    ),
    click.option(
        "--axles",
        is_flag=True,
        default=None,
        help="Columns of one quantity with an index, as v_Rad1 to v_Rad4, are those of axles; by "
        "default they are where two quantities of a log have as many.",
    ),
    click.option(
        "--events/--whole",
        default=None,
        help="Cut the slip events out of a log, as runs, or use all of its rows. By default events "
        "are cut out of a table of 10,000 rows or more with a time and without a column run; track "
        "uses them alone in a log that hardly slips.",
    ),
    click.option(
        "--dry-run", is_flag=True, help="Print how the columns are understood, and stop there."
    ),
)


class Log(File):
    """A file of measurements, a folder or a pattern of such, or the name of a set that ships."""

    def __init__(self, names: Sequence[str]) -> None:
        super().__init__(names, WANTED)

    def convert(self, value: str, param: Any, ctx: Any) -> str:
        if "://" in value:
            raise InputError(f"{value} is an address; download the file and name it here.")
        with suppress(OSError, ValueError):  # a name that is too long, or holds a zero
            if Path(value).is_dir() or (not Path(value).exists() and glob.glob(value)):
                return value
        return super().convert(value, param, ctx)


class Reading(NamedTuple):
    """What a command is told of the logs that it reads, as the functions of the library take it."""

    columns: Mapping[str, object]  # what was said of a quantity
    known: Mapping[str, Any]  # those of CORRECTIONS that were given
    events: bool | None  # whether the slip events of a log are used alone
    dry_run: bool

    def asked(self) -> Mapping[str, object]:
        """What was asked for by the names of the options; None is what was not."""
        delay = {"delay" if name == "delays" else name: one for name, one in self.known.items()}
        whole = {"columns": self.columns or None, **delay, "dry_run": self.dry_run or None}
        return {**whole, "events": self.events}

    def tables(self, files: Sequence[str], for_search: bool = False) -> "list[Measured]":
        """The measurements; what was understood of each is printed, refused or not.

        A search for effects is satisfied with columns of which it needs fewer rows, and ends a dry
        run by itself: others end here.
        """
        from adhesion_jax.data import as_one, check_curve
        from adhesion_jax.data.forces import Corrections
        from adhesion_jax.data.reading import NotUnderstoodError
        from adhesion_jax.data.stretches import FEW, FEW_OF_A_SEARCH
        from adhesion_jax.library.reading import all_of
        from adhesion_jax.report.measured.words import columns_table, understood

        corrections, few = Corrections(**self.known), FEW_OF_A_SEARCH if for_search else FEW
        with shown() as progress:
            try:
                found = all_of(files, self.columns, corrections, progress, few)
            except NotUnderstoodError as refused:
                click.echo(f"Columns as understood so far:\n{columns_table(refused.understood)}\n")
                raise
        click.echo("\n\n".join(map(understood, found)) + "\n")
        if self.dry_run and not for_search:
            check_curve(as_one(found))
            click.get_current_context().exit()
        return found

    def logs(self, files: Sequence[str], for_search: bool = False) -> "Sequence[Chosen]":
        """The same, of which the rows or slip events that are used are kept, and no other rows."""
        from adhesion_jax.data.events import events_of

        return events_of(self.tables(files, for_search), self.events)


def reading(command: Callable[..., None]) -> Callable[..., None]:
    """Adds the options; the command is then called with a `Reading`."""

    @wraps(command)
    def told(
        *args: Any,
        columns_file: Path | None,
        columns_named: Sequence[str],
        events: bool | None,
        dry_run: bool,
        **asked: Any,
    ) -> None:
        asked["delays"] = _delays(asked["delays"]) or None
        given = {name: asked.pop(name) for name in CORRECTIONS}
        known = {name: value for name, value in given.items() if value is not None}
        columns = _columns(columns_file, columns_named)
        command(*args, reading=Reading(columns, known, events, dry_run), **asked)

    for option in reversed(_OPTIONS):
        told = option(told)
    return told


def _delays(named: Sequence[str]) -> dict[str, float]:
    found: dict[str, float] = {}
    for name, written, one in _pairs("delay", named):
        try:
            found[name] = float(written)
        except ValueError:
            found[name] = math.nan
        if not name or not math.isfinite(found[name]):
            raise InputError(
                f'--delay "{one}" does not say how late a signal is; write NAME=SECONDS, as in '
                '"vehicle_speed=0.2".'
            )
    return found


def _columns(file: Path | None, named: Sequence[str]) -> Mapping[str, object]:
    columns: dict[str, object] = {} if file is None else _of_file(file)
    for quantity, column, one in _pairs("column", named):
        if not (quantity and column):
            raise InputError(
                f'--column "{one}" does not say what a column is; write QUANTITY=COLUMN [UNIT], '
                'as in "speed=v [km/h]".'
            )
        columns[quantity] = column
    return columns


def _pairs(option: str, named: Sequence[str]) -> Iterator[tuple[str, str, str]]:
    """What stands on both sides of the sign of equality, and the whole; each name comes once."""
    given: set[str] = set()
    for one in named:
        name, _, value = (part.strip() for part in one.partition("="))
        if name in given:
            raise InputError(f"--{option} {name} is given twice; name one {option} for it.")
        given.add(name)
        yield name, value, one


def _of_file(path: Path) -> dict[str, object]:
    try:
        if path.exists() and not path.is_file():
            raise InputError(f"--columns {path} is not a file; name a file of lines.")
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise InputError(
            f"--columns {path} cannot be read ({error.strerror}); name a file of lines such as "
            'speed = "v [km/h]".'
        ) from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(
            f"--columns {path} is not TOML ({str(error).removesuffix('.')}); write lines such as "
            'speed = "v [km/h]".'
        ) from None
