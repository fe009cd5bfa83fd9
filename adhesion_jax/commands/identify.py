"""Which adhesion curve measured points follow."""

from pathlib import Path

import click

from adhesion_jax.curves import CURVES
from adhesion_jax.files import output_directory, staged
from adhesion_jax.library.identify import IDENTIFY_FILES, identify


def main(file: str, curve: str, events: bool | None, out: Path) -> None:
    """Write what the measured points of a file, or of a set that ships, say of a curve, or all."""
    found = identify(file, CURVES if curve == "all" else curve, events)
    with staged(output_directory(out), IDENTIFY_FILES) as stage:
        found.write(stage)
    click.echo(f"{found}\n\nWritten to {out}")
