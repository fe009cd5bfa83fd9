"""`adhesion study`: how often the discovery is right."""

from pathlib import Path

import click

from adhesion_jax.command_line.command import SEED, Folder, perform, with_cluster
from adhesion_jax.errors import InputError


@click.command()
@click.option(
    "--null",
    type=click.IntRange(min=0),
    default=200,
    show_default=True,
    help="Sets with nothing hidden in them; the noise of half of them is slow.",
)
@click.option(
    "--powers",
    type=click.IntRange(min=0),
    default=10,
    show_default=True,
    help="Sets of each effect and strength.",
)
@click.option(
    "--pairs",
    type=click.IntRange(min=0),
    default=24,
    show_default=True,
    help="Sets with two effects of different families.",
)
@click.option(
    "--random",
    type=click.IntRange(min=0),
    default=100,
    show_default=True,
    help="Sets with an effect that is a random smooth function of one or two columns.",
)
@click.option(
    "--logs",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Logs of each kind, with nothing hidden but the noise of the slip.",
)
@click.option(
    "--log-effects",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Logs with each of three effects, the kinds of logs by turns.",
)
@click.option(
    "--workers",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="Processes; the results do not depend on their number.",
)
@click.option("--seed", type=SEED, default=0, show_default=True)
@with_cluster
@click.option("--resume", is_flag=True, help="Compute what an interrupted study left over.")
@click.option(
    "--out",
    type=Folder(),
    default=Path("out/discovery_study"),
    show_default=True,
)
def main(
    workers: int,
    cluster: str | None,
    shared_folder: bool,
    resume: bool,
    out: Path,
    **sizes: int,
) -> None:
    """Run the discovery on simulated sets and count what it gets right."""
    if not any(count for name, count in sizes.items() if name != "seed"):
        raise InputError("A study of no sets says nothing; give --null or --powers above 0.")
    perform(
        "study",
        workers=workers,
        cluster=cluster,
        shared_folder=shared_folder,
        resume=resume,
        out=out,
        **sizes,
    )
