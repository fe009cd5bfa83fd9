"""`adhesion identify`: which adhesion curve measured points follow."""

from pathlib import Path
from typing import Any

import click

from adhesion_jax.command_line.catalogue import catalogue
from adhesion_jax.command_line.command import File, Folder, Names, examples, perform
from adhesion_jax.command_line.listing import listing
from adhesion_jax.command_line.reading import FILES, reading
from adhesion_jax.command_line.slips import slip_events, slip_noise

KNOWN = catalogue()


@click.command(
    epilog=examples(
        "identify eurosprinter",
        'identify log.csv --column "axle_force=Zugkraft [kN]" --dry-run',
        "identify log.csv --curve kiencke,burckhardt,mine.py:Mine --out out/mine",
    )
)
@click.argument("files", type=File(KNOWN.data, f"name {FILES}"), nargs=-1, required=True)
@reading
@click.option(
    "--curve",
    type=Names((*KNOWN.curves, "all"), "curve"),
    default="all",
    help=f"Some of {', '.join(KNOWN.curves)}, FILE.py:NAME, or all, divided by commas.",
    show_default=True,
)
@slip_events
@click.option(
    "--by",
    metavar="COLUMN",
    help="Compare the groups of rows by this column, text included, by run, or by auto: the column "
    "that predicts best.",
)
@slip_noise
@click.option(
    "--out",
    type=Folder(),
    default=Path("out/identify"),
    help="Folder for report.html, curves.csv, curves.png, law.json, verdict.txt, of a log "
    "events.png, and with --by runs.csv and runs.png.",
    show_default=True,
)
@listing(data=KNOWN.data, curves=KNOWN.curves)
def main(**asked: Any) -> None:
    """Fit adhesion curves to the measured points of FILES and say what they are worth.

    FILES are one or more .csv, .csv.gz, .txt, .tsv, .dat, .asc or .parquet files of slip (or the
    speeds of wheel and train) and adhesion (or force and load), in columns that are recognised by
    their names and units or named by --column; --dry-run shows how they are understood. Or the name
    of a data set that ships with the package: eurosprinter. (roller-rig has one slip and no curve:
    adhesion discover.)
    """
    perform("identify", **asked)
