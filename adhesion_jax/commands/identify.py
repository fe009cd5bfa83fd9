"""Which adhesion curve measured points follow."""

from collections.abc import Mapping
from pathlib import Path

import click

from adhesion_jax.commands.reading import read
from adhesion_jax.curves import CURVES
from adhesion_jax.files import output_directory, staged
from adhesion_jax.library.identify import IDENTIFY_FILES, identify


def main(
    file: str,
    curve: str,
    out: Path,
    columns: Mapping[str, object],
    wheel_radius: float | None,
    dry_run: bool,
) -> None:
    """Write what the measured points of a file, or of a set that ships, say of a curve, or all."""
    (points,) = read([file], columns, wheel_radius)
    if dry_run:
        return
    found = identify(points, CURVES if curve == "all" else curve)
    with staged(output_directory(out), IDENTIFY_FILES) as stage:
        found.write(stage)
    click.echo(f"{found}\n\nWritten to {out}")
