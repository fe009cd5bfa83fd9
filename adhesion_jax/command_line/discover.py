"""`adhesion discover`: which physical effect a law lacks in measured data."""

import textwrap
from typing import Any

import click

from adhesion_jax.command_line.catalogue import catalogue
from adhesion_jax.command_line.command import (
    SEED,
    Names,
    begin,
    command,
    listing,
    out_folder,
    shown,
    written,
)
from adhesion_jax.command_line.reading import Log, Reading, reading, slip_noise
from adhesion_jax.plugins import Part

NAMES = catalogue().names

_RUNS = Log(NAMES["data"])


@command(
    "discover roller-rig",
    "discover train.csv --test test.csv --effects mine.py:Mine --out out/mine",
)
@click.argument("train", type=_RUNS, nargs=-1, required=True)
@reading
@click.option(
    "--test",
    "tests",
    type=_RUNS,
    multiple=True,
    help="File of runs for the error before and after.",
)
@click.option(
    "--curve",
    type=Names((*NAMES["curves"], "auto"), "curve"),
    default="auto",
    help=f"Base curves to choose from: auto, {', '.join(NAMES['curves'])}, or FILE.py:NAME, "
    "divided by commas.",
)
@click.option("--seed", type=SEED, default=0)
@click.option(
    "--effects",
    type=Names((), "effect"),
    metavar="FILE.py:NAME[,...]",
    help="Effects of your own, which are searched for beside those of the package.",
)
@slip_noise
@click.option(
    "--correct",
    is_flag=True,
    help="Where boosted trees predict what the law leaves, predict --test with them as well.",
)
@out_folder("discover", "report.html, report.md, report.json, law.json and figures")
@listing(data=NAMES["data"], curves=NAMES["curves"], effects=NAMES["effects"])
def main(
    train: tuple[str, ...],
    tests: tuple[str, ...],
    curve: tuple[Any, ...],
    effects: tuple[Part, ...] | None,
    reading: Reading,
    **asked: Any,
) -> None:
    """Find what an adhesion curve lacks in the runs of TRAIN, and what it is worth.

    TRAIN is one or more files of the columns that adhesion identify takes, with a column run (or
    time_s, from whose gaps runs are told), or the name of a data set that ships with the package:
    eurosprinter, roller-rig. Nothing is fitted to the runs of --test.
    """
    _, curves = begin(effects, curve)
    from adhesion_jax.files import output_directory
    from adhesion_jax.library.discover import discover

    if reading.dry_run:
        for files in filter(None, (train, tests)):
            reading.tables(files, for_search=True)
        return
    logs = reading.logs(train, for_search=True)
    test = reading.logs(tests, for_search=True) if tests else None
    output_directory(asked["out"])
    used = " ".join(filter(None, (log.sentence for log in logs)))
    if used:
        click.echo(f"{textwrap.fill(used, 96)}\n")
    with shown() as progress:
        found = discover(logs, test, curves, progress=progress, **asked)
    written(found, asked["out"], found.findings.seconds)
