"""What the commands of the experiments have in common: a bar, and files that are there whole."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import click
from tqdm import tqdm

from adhesion_jax import runtime
from adhesion_jax.files import output_directory, staged, write_metadata


@contextmanager
def written(
    out: Path, names: Sequence[str], config: Mapping[str, object] | None = None
) -> Iterator[tuple[Path, Callable[[str], None]]]:
    """A hidden folder for these files, which are moved to `out` at the end, and what tells of them.

    What is told is printed when the files are there, so that none is lost where nobody reads it;
    the last line says where they are. With a configuration, that is written with the time and the
    machine to metadata.json.
    """
    directory, began, told = output_directory(out), time.perf_counter(), list[str]()
    with staged(directory, names) as stage:
        yield stage, told.append
        if config is not None:
            write_metadata(stage / "metadata.json", described(config, began))
    click.echo("\n".join(told))
    click.echo(f"\nWritten to {directory} in {time.perf_counter() - began:.0f} s")


def described(config: Mapping[str, object], began: float) -> Mapping[str, object]:
    """What metadata.json says of a command that began at this time of the clock."""
    return {
        "config": config,
        "wall_seconds": time.perf_counter() - began,
        **runtime.describe(),
    }


@contextmanager
def bar(unit: str, total: int | None = None) -> Iterator[Callable[[str], None]]:
    """What moves a bar on by one and shows what is done."""
    with tqdm(total=total, unit=unit, disable=None) as shown:

        def advance(words: str) -> None:
            shown.set_description(words)
            shown.update()

        yield advance
