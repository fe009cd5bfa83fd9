"""`adhesion claims`: the claims of published papers against what can be computed."""

from pathlib import Path
from typing import Any

import click

from adhesion_jax.command_line.command import SEED, Folder, perform


@click.command()
@click.option("--runs", type=click.IntRange(min=100), default=512, show_default=True)
@click.option("--seed", type=SEED, default=0, show_default=True)
@click.option("--out", type=Folder(), default=Path("out/claims"), show_default=True)
def main(**asked: Any) -> None:
    """Compute what the papers claim and say which claims are reproduced."""
    perform("claims", **asked)
