"""Which adhesion curve measured points follow."""

from pathlib import Path

import click
from tqdm import tqdm

from adhesion_jax.curves import CURVES
from adhesion_jax.files import output_directory, staged
from adhesion_jax.library.identify import IDENTIFY_FILES, identify


def main(file: str, curve: str, by: str | None, slip_noise: float | None, out: Path) -> None:
    """Write what the measured points of a file, or of a set that ships, say of a curve, or all."""
    directory = output_directory(out)
    with tqdm(total=100, unit="%", bar_format=_BAR, leave=False) as bar:

        def progress(words: str, share: float) -> None:
            bar.set_description_str(words)
            bar.update(100 * share - bar.n)

        found = identify(file, CURVES if curve == "all" else curve, by, slip_noise, progress)
    with staged(directory, IDENTIFY_FILES) as stage:
        found.write(stage)
    click.echo(f"{found}\n\nWritten to {out}")


_BAR = "{desc}: {percentage:3.0f} %|{bar}| {elapsed}<{remaining}"
