"""`adhesion speed`: speed on one core beside a peer in the same run."""

from pathlib import Path
from typing import Any

import click

from adhesion_jax.command_line.command import SEED, Folder, perform


@click.command()
@click.option("--repeats", type=click.IntRange(min=1), default=3, show_default=True)
@click.option("--seed", type=SEED, default=0, show_default=True)
@click.option("--out", type=Folder(), default=Path("out/speed"), show_default=True)
def main(**asked: Any) -> None:
    """Time the identifiers; noise and compilation are excluded.

    Whole blocks on he2018-blocks, in identifications per CPU-second; recursions on streams of
    10,000 runs, in samples per CPU-second. The methods take turns, `repeats` times, so that a
    machine whose speed drifts is fair to all; the median is reported.
    """
    perform("speed", **asked)
