"""`adhesion regression`: accuracy and speed of every identifier against a baseline."""

from pathlib import Path
from typing import Any

import click

from adhesion_jax.command_line.command import Folder, perform
from adhesion_jax.errors import InputError


@click.command()
@click.option(
    "--baseline",
    type=click.Path(path_type=Path, dir_okay=False),
    default=Path("results/baseline.csv"),
    show_default=True,
    help="The table to hold against; ratios of speed are best kept on one kind of processor.",
)
@click.option("--update", is_flag=True, help="Write the baseline anew and compare nothing.")
@click.option(
    "--out",
    type=Folder(),
    default=Path("out/regression"),
    show_default=True,
    help="Folder for the fresh table and the comparison.",
)
def main(baseline: Path, update: bool, **asked: Any) -> None:
    """Measure every identifier on a small fixed set; exit status 1 where one got worse."""
    if not update and not baseline.is_file():
        raise InputError(f"--baseline {baseline} does not exist; make it with --update.")
    perform("regression", baseline=baseline, update=update, **asked)
