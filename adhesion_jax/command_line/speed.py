"""`adhesion speed`: speed beside other libraries in the same run."""

from pathlib import Path
from typing import Any

import click

from adhesion_jax.command_line.command import SEED, Folder, perform


@click.command()
@click.option("--repeats", type=click.IntRange(min=1), default=5, show_default=True)
@click.option("--seed", type=SEED, default=0, show_default=True)
@click.option("--out", type=Folder(), default=Path("out/speed"), show_default=True)
def main(**asked: Any) -> None:
    """Time identifiers, recursions, plants and whole jobs beside other libraries.

    Whole blocks on he2018-blocks beside scipy's differential evolution and others, recursions on
    streams of 10,000 runs beside NumPy, plants beside C, and how near all come to loops in C and to
    the matrix product of this machine; some of them on a GPU, where jax finds one. What is timed
    takes turns, `repeats` times, so that a machine whose speed drifts is fair to all; the median is
    reported, and its range. numba, pygmo and evosax are timed where they are installed.
    """
    perform("speed", **asked)
