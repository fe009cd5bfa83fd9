"""`adhesion discover`: which physical effect a law lacks in measured data."""

from pathlib import Path
from typing import Any

import click

from adhesion_jax.command_line.catalogue import catalogue
from adhesion_jax.command_line.command import FiniteRange, Folder, Name, Names, Recorded, perform
from adhesion_jax.command_line.reading import Log, reading
from adhesion_jax.command_line.slip_events import slip_events
from adhesion_jax.errors import InputError
from adhesion_jax.plugins import Part

KNOWN = catalogue()

_RUNS = Log(KNOWN.data)


class Plantable(Names):
    """Names of the package, of --effects, or parts FILE.py:NAME."""

    def convert(self, value: Any, param: Any, ctx: Any) -> Any:
        own = ctx.params.get("effects")
        names = [part.name for part in own] if isinstance(own, tuple) else []
        return Names((*self.names, *names), self.kind).convert(value, param, ctx)


@click.command(cls=Recorded)
@click.argument("train", type=_RUNS, nargs=-1)
@reading
@slip_events
@click.option(
    "--test",
    "tests",
    type=_RUNS,
    multiple=True,
    help="File of runs for the error before and after.",
)
@click.option(
    "--base",
    type=Name((*KNOWN.curves, "auto"), "curve"),
    default="auto",
    help=f"auto, {', '.join(KNOWN.curves)}, or FILE.py:NAME.",
    show_default=True,
)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True)
@click.option(
    "--effects",
    type=Names((), "effect"),
    is_eager=True,  # their names may be planted
    metavar="FILE.py:NAME[,...]",
    help="Effects of your own, which are searched for beside those of the package.",
)
@click.option(
    "--simulate",
    "planted",
    type=Plantable((*KNOWN.effects, "none", ""), "effect"),
    metavar="EFFECTS",
    help="Instead of TRAIN: a simulated campaign with these effects, by commas, or none.",
)
@click.option(
    "--slip-noise",
    type=FiniteRange(min=0, min_open=True),
    help="Standard deviation of the noise of the wheel speed in m/s (of slip, where there is no "
    "vehicle speed); by default it is estimated.",
)
@click.option(
    "--correct",
    is_flag=True,
    help="Where boosted trees predict what the law leaves, predict --test with them as well.",
)
@click.option(
    "--out",
    type=Folder(),
    default=Path("out/discover"),
    help="Folder for report.html, report.md, report.json, law.json and figures.",
    show_default=True,
)
def main(
    train: tuple[str, ...],
    tests: tuple[str, ...],
    planted: tuple[Any, ...] | None,
    effects: tuple[Part, ...] | None,
    **asked: Any,
) -> None:
    """Find what an adhesion curve lacks in the runs of TRAIN, and what it is worth.

    TRAIN is one or more files of the columns that adhesion identify
    takes, with a column run (or time_s, from whose gaps runs are told), or the name of a data set
    that ships with the package: eurosprinter, roller-rig. Nothing is fitted to the runs of --test.
    """
    if (planted is None) == (not train):
        raise InputError("Name the files of TRAIN, or a campaign by --simulate, but not both.")
    if planted is not None and tests:
        raise InputError("--test does not go with --simulate, which draws its own test runs.")
    if planted is not None:
        planted = tuple(name for name in planted if name not in ("", "none"))
    perform("discover", *(effects or ()), train=train, tests=tests, planted=planted, **asked)
