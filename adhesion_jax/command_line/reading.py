"""The options by which every command that reads measurements is told what their columns are."""

import tomllib
from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from pathlib import Path
from typing import Any

import click

from adhesion_jax.command_line.command import FiniteRange
from adhesion_jax.errors import InputError

#: What can be read, for a refusal.
FILES = "a .csv, .csv.gz, .txt, .tsv or .parquet file"

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
        "--dry-run",
        is_flag=True,
        help="Print how the columns are understood, and stop there.",
    ),
)


def reading(command: Callable[..., None]) -> Callable[..., None]:
    """Adds the options; the command is then called with columns, wheel_radius and dry_run.

    `columns` maps a quantity to what was said of it, as the functions of the library take it.
    """

    @wraps(command)
    def told(
        *args: Any, columns_file: Path | None, columns_named: Sequence[str], **asked: Any
    ) -> None:
        command(*args, columns=_columns(columns_file, columns_named), **asked)

    for option in reversed(_OPTIONS):
        told = option(told)
    return told


def _columns(file: Path | None, named: Sequence[str]) -> Mapping[str, object]:
    columns: dict[str, object] = {} if file is None else _of_file(file)
    given: set[str] = set()
    for one in named:
        quantity, equals, column = (part.strip() for part in one.partition("="))
        if not (quantity and equals and column):
            raise InputError(
                f'--column "{one}" does not say what a column is; write QUANTITY=COLUMN [UNIT], '
                'as in "speed=v [km/h]".'
            )
        if quantity in given:
            raise InputError(f"--column {quantity} is given twice; name one column for it.")
        given.add(quantity)
        columns[quantity] = column
    return columns


def _of_file(path: Path) -> dict[str, object]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise InputError(
            f"--columns {path} cannot be read ({error.strerror}); name a file of lines such as "
            'speed = "v [km/h]".'
        ) from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(
            f"--columns {path} is not TOML ({str(error).removesuffix('.')}); write lines such as "
            'speed = "v [km/h]".'
        ) from None
