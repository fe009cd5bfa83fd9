"""`adhesion discover`: which physical effect a law lacks in measured data."""

from pathlib import Path
from typing import Any

import click

from adhesion_jax.command_line.catalogue import catalogue
from adhesion_jax.command_line.command import SEED, File, Folder, Names, examples, perform
from adhesion_jax.command_line.listing import listing
from adhesion_jax.command_line.reading import FILES, reading
from adhesion_jax.command_line.slips import slip_events, slip_noise
from adhesion_jax.errors import InputError
from adhesion_jax.plugins import Part

KNOWN = catalogue()

_RUNS = File(KNOWN.data, f"name {FILES}")


class Plantable(Names):
    """Names of the package, of --effects, or parts FILE.py:NAME."""

    def convert(self, value: Any, param: Any, ctx: Any) -> Any:
        own = ctx.params.get("effects")
        names = [part.name for part in own] if isinstance(own, tuple) else []
        return Names((*self.names, *names), self.kind).convert(value, param, ctx)


@click.command(
    epilog=examples(
        "discover roller-rig",
        "discover train.csv --test test.csv --effects mine.py:Mine --out out/mine",
        "discover --simulate humidity,patch",
    )
)
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
    "--curve",
    type=Names((*KNOWN.curves, "auto"), "curve"),
    default="auto",
    help=f"Base curves to choose from: auto, {', '.join(KNOWN.curves)}, or FILE.py:NAME, divided "
    "by commas.",
    show_default=True,
)
@click.option("--seed", type=SEED, default=0, show_default=True)
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
@slip_noise
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
@listing(data=KNOWN.data, curves=KNOWN.curves, effects=KNOWN.effects)
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
