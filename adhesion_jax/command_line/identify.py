"""`adhesion identify`: which adhesion curve measured points follow."""

from collections.abc import Mapping
from typing import Any

import click

from adhesion_jax.command_line.catalogue import catalogue
from adhesion_jax.command_line.command import (
    Names,
    begin,
    command,
    listing,
    out_folder,
    record,
    shown,
)
from adhesion_jax.command_line.reading import Log, read, reading, slip_events, slip_noise

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
@slip_events
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
    events: bool | None,
    by: str | None,
    columns: Mapping[str, object],
    known: Mapping[str, Any],
    dry_run: bool,
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
    from adhesion_jax.data import as_one, check_curve
    from adhesion_jax.data.events import events_of
    from adhesion_jax.library.identify import identify, with_groups

    measured = read(files, with_groups(columns, by), known)
    if dry_run:
        check_curve(as_one(measured))
        return
    # Nothing holds the log while the curves are fitted to its events.
    logs = events_of(measured, events)
    del measured
    curves = None if "all" in names else names
    with shown() as progress:
        found = identify(logs, curves, by=by, progress=progress, **asked)
    record(asked["out"])
    click.echo(f"{found}\n\nWritten to {asked['out']}")
