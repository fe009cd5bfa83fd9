"""What online methods know of the largest adhesion after each sample of a log."""

from pathlib import Path

import click
from tqdm import tqdm

from adhesion_jax.files import output_directory, staged
from adhesion_jax.library.track import METHODS, TRACK_FILES, track


def main(
    log: str,
    identifiers: tuple[str, ...],
    initial_slope: float | None,
    events: bool | None,
    out: Path,
) -> None:
    """Write what the methods make of the log of a file, or of a set that ships."""
    output_directory(out)
    with tqdm(total=100, desc="reading", bar_format=_BAR, leave=False) as bar:

        def progress(done: int, total: int) -> None:
            bar.set_description_str("following", refresh=False)
            bar.update(100 * done / total - bar.n)

        found = track(log, identifiers or METHODS, initial_slope, events, progress)
    with staged(out, TRACK_FILES) as stage:
        found.write(stage)
    click.echo(f"{found}\n\nWritten to {out}")


_BAR = "{desc}: {percentage:3.0f} %|{bar}| {elapsed}<{remaining}"
