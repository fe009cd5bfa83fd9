"""`adhesion identify`: which adhesion curve measured points follow."""

from pathlib import Path
from typing import Any

import click

from adhesion_jax.command_line.catalogue import catalogue
from adhesion_jax.command_line.command import FiniteRange, Folder, Name, Recorded, perform
from adhesion_jax.command_line.reading import Log, reading
from adhesion_jax.command_line.slip_events import slip_events

KNOWN = catalogue()


@click.command(cls=Recorded)
@click.argument("files", type=Log(KNOWN.data), nargs=-1, required=True)
@reading
@click.option(
    "--curve",
    type=Name((*KNOWN.curves, "all"), "curve"),
    default="all",
    help=f"{', '.join(KNOWN.curves)}, FILE.py:NAME, or all.",
    show_default=True,
)
@slip_events
@click.option(
    "--by",
    metavar="COLUMN",
    help="Compare the groups of rows by this column, text included, by run, or by auto: the column "
    "that predicts best.",
)
@click.option(
    "--slip-noise",
    type=FiniteRange(min=0),
    help="Standard deviation of the noise of the wheel speed in m/s (of slip, where there is no "
    "vehicle speed), 0 for an exact slip; by default it is estimated where there is time_s.",
)
@click.option(
    "--out",
    type=Folder(),
    default=Path("out/identify"),
    help="Folder for report.html, curves.csv, parameters.csv, curves.png, law.json, verdict.txt, "
    "of a log events.png, and with --by runs.csv and runs.png.",
    show_default=True,
)
def main(**asked: Any) -> None:
    """Fit adhesion curves to the measured points of FILES and say what they are worth.

    FILES are tables of text, spreadsheets, .parquet, .mat, .h5, .mf4, .tdms or .feather files, or a
    folder or a pattern of such as one log, of slip (or the speeds of wheel and train) and adhesion
    (or force and load), in columns that are recognised by their names and units or named by
    --column; --dry-run shows how they are understood. Or the name of a data set that ships with the
    package: eurosprinter. (roller-rig has one slip and no curve: adhesion discover.)
    """
    perform("identify", **asked)
