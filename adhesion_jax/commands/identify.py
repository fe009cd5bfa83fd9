"""`python -m experiments.identify`: which adhesion curve measured points follow."""

from pathlib import Path

import click

from adhesion_jax.commands.command import Folder, output_directory
from adhesion_jax.curves import CURVES
from adhesion_jax.errors import InputError
from adhesion_jax.files import staged
from adhesion_jax.library.identify import IDENTIFY_FILES, identify


@click.command()
@click.argument("file")
@click.option("--curve", default="all", help=f"{', '.join(CURVES)}, or all.", show_default=True)
@click.option(
    "--out",
    type=Folder(),
    default=Path("out/identify"),
    help="Folder for curves.csv, curves.png and verdict.txt.",
    show_default=True,
)
def main(file: str, curve: str, out: Path) -> None:
    """Fit adhesion curves to the measured points of FILE and say what they are worth.

    FILE is a .csv, .csv.gz or .parquet file with the columns slip_ratio (or slip_velocity_mps)
    and adhesion (or tangential_force_N with normal_load_N), or the name of a data set that ships
    with the package: eurosprinter. (roller-rig has one slip and no curve: experiments.discover.)
    """
    if curve != "all" and curve not in CURVES:
        raise InputError(f"--curve {curve} is not known; name one of {', '.join(CURVES)}, or all.")
    folder = output_directory(out)
    found = identify(file, CURVES if curve == "all" else curve)
    with staged(folder, IDENTIFY_FILES) as stage:
        found.write(stage)
    click.echo(f"{found}\n\nWritten to {out}")
