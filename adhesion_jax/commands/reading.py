"""What every command that takes measurements does first: it reads them and says what it read."""

from collections.abc import Mapping, Sequence

import click
from tqdm import tqdm

from adhesion_jax.data import Measured
from adhesion_jax.library.reading import all_of
from adhesion_jax.report.measured.understood import understood


def read(
    files: Sequence[str], columns: Mapping[str, object], wheel_radius: float | None
) -> list[Measured]:
    """The measurements of the files; what was understood of each is printed."""
    with tqdm(total=100, unit="%", bar_format=BAR, leave=False, disable=None) as bar:

        def progress(words: str, share: float) -> None:
            bar.set_description_str(words)
            bar.update(100 * share - bar.n)

        found = all_of(files, columns, wheel_radius, progress)
    click.echo("\n\n".join(map(understood, found)) + "\n")
    return found


#: A bar of per cent with the time that is left, after the words of what is done.
BAR = "{desc} {percentage:3.0f} %|{bar}| {elapsed}<{remaining}"
