"""`adhesion traction`: a published traction control system on its plant, or the leaderboard."""

from pathlib import Path
from typing import Any

import click

from adhesion_jax.command_line.catalogue import catalogue
from adhesion_jax.command_line.command import (
    SEED,
    File,
    FiniteRange,
    Name,
    Names,
    begin,
    command,
    in_shards,
    listing,
    out_folder,
    written,
)
from adhesion_jax.errors import InputError
from adhesion_jax.options import MOST_RUNS

NAMES = catalogue().names

#: In the place of a system: methods on equal terms.
BOARD = "leaderboard"

#: The options that one of both has alone.
_OF_SYSTEM = ("observer", "seeker", "controller", "animate")
_OF_BOARD = ("methods", "rails", "law", "track", "budget", "tuning_seed", "beside")


class Rails(Names):
    """Names of rails, or files of curves, divided by commas."""

    def convert(self, value: Any, param: Any, ctx: Any) -> Any:
        if isinstance(value, tuple):
            return value
        wanted = f"name {', '.join(self.names)}, or a curves.csv of adhesion identify"
        file = File(self.names, wanted)
        return tuple(file.convert(one.strip(), param, ctx) for one in value.split(","))


def _parts(option: str, kind: str, what: str, several: bool = False) -> Any:
    """An option for parts of a loop that ship or are one's own, by their names."""
    of = Names if several else Name
    words = f"{what}: {', '.join(NAMES[kind])}, FILE.py:NAME."
    return click.option(f"--{option}", type=of(NAMES[kind], kind[:-1]), help=words)


@command(
    "traction --system hxd1f",
    "traction --system fang2018 --runs 0 --controller rate-feedback --out out/eq8",
    "traction --system leaderboard --methods mine.py:Mine,perturb-and-observe",
)
@click.option(
    "--system",
    type=Name((*NAMES["systems"], BOARD)),
    required=True,
    help=f"{', '.join(NAMES['systems'])}, or {BOARD}: methods tuned and judged on equal terms.",
)
@click.option(
    "--plant",
    type=File(NAMES["plants"], f"name a TOML file or {', '.join(NAMES['plants'])}"),
    help=f"A TOML file, or a plant that ships: {', '.join(NAMES['plants'])}.",
)
@_parts("observer", "observers", "Instead of the paper's")
@_parts("seeker", "seekers", "Instead of the paper's")
@_parts("controller", "controllers", "Instead of the paper's, side by side", several=True)
@_parts("methods", "entrants", "Of the leaderboard (all)", several=True)
@click.option(
    "--rails",
    type=Rails(NAMES["families"]),
    help=f"Of the leaderboard: {', '.join(NAMES['families'])}, or a curves.csv of adhesion "
    "identify. Methods are tuned on the first.",
)
@click.option(
    "--law",
    type=File(wanted="name a law.json of adhesion discover"),
    help="Of the leaderboard: a law.json of adhesion discover, on whose rails methods are judged.",
)
@click.option(
    "--track",
    type=Name(("nominal", "robust")),
    help="Of the leaderboard: nominal, or robust: under disturbances that no method knows.",
)
@click.option(
    "--budget",
    type=click.IntRange(1, 2**16),
    help="Configurations that each method of the leaderboard is tuned with (64).",
)
@click.option(
    "--tuning-seed", type=SEED, help="Of the rails that methods of the leaderboard are tuned on."
)
@click.option(
    "--beside",
    type=File(wanted="name a leaderboard.csv"),
    help="A leaderboard.csv whose rows stand beside those of this one.",
)
@click.option(
    "--runs",
    type=click.IntRange(0, MOST_RUNS),
    help="With noise (32); of the leaderboard for each of three seeds (40).",
)
@click.option("--seed", type=SEED, default=0)
@click.option("--step", type=FiniteRange(min=1e-6, max=1.0), help="Of the plant, in s.")
@click.option("--animate", is_flag=True, help="The operating point as a moving picture, too.")
@in_shards
@out_folder("traction")
@listing(
    systems=NAMES["systems"],
    plants=NAMES["plants"],
    observers=NAMES["observers"],
    seekers=NAMES["seekers"],
    controllers=NAMES["controllers"],
    methods=NAMES["entrants"],
    rails=NAMES["families"],
)
def main(system: str, workers: int | None, out: Path, **asked: Any) -> None:
    """Run a published control system on its plant: its table, its figures and its metrics.

    Every scenario of the paper runs once without noise and `--runs` times with noise. With an
    observer, a seeker or a controller named, it takes the place of the paper's own.

    The leaderboard tunes methods of slip control with equal budgets on drawn rails, and judges them
    on others.
    """
    of_board = system == BOARD
    for name in _OF_SYSTEM if of_board else _OF_BOARD:
        value = asked.pop(name)
        if value is not None and value is not False:
            raise InputError(
                f"--{name.replace('_', '-')} is no option of --system {system}; leave it out."
            )
    asked = {name: value for name, value in asked.items() if value is not None}
    asked = dict(zip(asked, begin(*asked.values()), strict=True))
    from adhesion_jax.library.leaderboard import Leaderboard, traction_leaderboard
    from adhesion_jax.library.traction import Traction, traction_control
    from adhesion_jax.runtime import CORES

    asked = {**asked, "workers": workers or CORES, "out": out}
    found: Leaderboard | Traction = (
        traction_leaderboard(**asked) if of_board else traction_control(system, **asked)
    )
    written(found, out, found.seconds)
