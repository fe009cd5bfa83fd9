"""`adhesion peers`: the discovery against what a user would try instead."""

from pathlib import Path
from typing import Any

import click

from adhesion_jax.command_line.catalogue import catalogue
from adhesion_jax.command_line.command import SEED, Folder, Names, perform
from adhesion_jax.errors import InputError

KNOWN = catalogue()


@click.command()
@click.option(
    "--simulated",
    type=click.IntRange(min=0),
    default=23,
    show_default=True,
    help="Simulated sets; about a third of them have nothing hidden.",
)
@click.option(
    "--random",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Simulated sets with an effect that is a random function of one or two columns.",
)
@click.option("--sets", type=click.Path(path_type=Path), help="Folder of stored sets to add.")
@click.option(
    "--methods", type=Names(KNOWN.peers), help=f"Of {', '.join(KNOWN.peers)}; by default all."
)
@click.option("--seed", type=SEED, default=0, show_default=True)
@click.option(
    "--out",
    type=Folder(),
    default=Path("out/discovery_peers"),
    show_default=True,
)
def main(simulated: int, random: int, sets: Path | None, **asked: Any) -> None:
    """Errors, names and false names of the discovery and of general methods on the same sets."""
    if not (simulated or random or sets):
        raise InputError("There is no set to work on; give --simulated above 0 or --sets FOLDER.")
    perform("peers", simulated=simulated, random=random, sets=sets, **asked)
