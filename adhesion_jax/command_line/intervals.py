"""How often the intervals of `adhesion identify` hold the truth, on simulated records."""

from pathlib import Path

import click

from adhesion_jax.command_line.command import Folder, perform


@click.command()
@click.option(
    "--sets",
    type=click.IntRange(min=1),
    default=1000,
    show_default=True,
    help="Record sets of each true curve and noise.",
)
@click.option(
    "--workers",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="Processes; the results do not depend on their number.",
)
@click.option(
    "--out",
    type=Folder(),
    default=Path("out/intervals"),
    help="Folder for sets.csv, coverage.csv, metadata.json and coverage.png.",
    show_default=True,
)
def main(sets: int, workers: int, out: Path) -> None:
    """Count how often the 95 % intervals of the peak hold the true one, over simulated records."""
    perform("intervals", sets=sets, workers=workers, out=out)
