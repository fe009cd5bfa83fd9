"""`adhesion identify`: which adhesion curve measured points follow."""

from typing import Any

import click

from adhesion_jax.command_line.catalogue import catalogue
from adhesion_jax.command_line.command import (
    Names,
    begin,
    command,
    listing,
    out_folder,
    shown,
    written,
)
from adhesion_jax.command_line.reading import Log, Reading, reading, slip_noise

NAMES = catalogue().names


@command(
    "identify eurosprinter",
    'identify log.csv --column "axle_force=Zugkraft [kN]" --dry-run',
    "identify log.csv --curve kiencke,burckhardt,mine.py:Mine --out out/mine",
)
@click.argument("files", type=Log(NAMES["data"]), nargs=-1, required=True)
@reading
@click.option(
    "--curve",
    type=Names((*NAMES["curves"], "all"), "curve"),
    default="all",
    help=f"Some of {', '.join(NAMES['curves'])}, FILE.py:NAME, or all, divided by commas.",
)
@click.option(
    "--by",
    metavar="COLUMN",
    help="Compare the groups of rows by this column, text included, by run, or by auto: the column "
    "that predicts best.",
)
@slip_noise
@out_folder(
    "identify",
    "report.html, curves.csv, parameters.csv, curves.png, law.json, verdict.txt, of a log "
    "events.png, and with --by runs.csv and runs.png",
)
@listing(data=NAMES["data"], curves=NAMES["curves"])
def main(
    files: tuple[str, ...],
    curve: tuple[Any, ...],
    by: str | None,
    reading: Reading,
    **asked: Any,
) -> None:
    """Fit adhesion curves to the measured points of FILES and say what they are worth.

    FILES are tables of text, spreadsheets, .parquet, .mat, .h5, .mf4, .tdms or .feather files, or a
    folder or a pattern of such as one log, of slip (or the speeds of wheel and train) and adhesion
    (or force and load), in columns that are recognised by their names and units or named by
    --column; --dry-run shows how they are understood. Or the name of a data set that ships with the
    package: eurosprinter. (roller-rig has one slip and no curve: adhesion discover.)
    """
    (names,) = begin(curve)
    from adhesion_jax.library.identify import identify, with_groups

    logs = reading._replace(columns=with_groups(reading.columns, by)).logs(files)
    curves = None if "all" in names else names
    with shown() as progress:
        found = identify(logs, curves, by=by, progress=progress, **asked)
    written(found, asked["out"])
