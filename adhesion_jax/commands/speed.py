"""Speed on one core beside a peer in the same run: blocks beside scipy, recursions beside NumPy."""

from pathlib import Path

import click
from tqdm import tqdm

from adhesion_jax.files import output_directory, staged, write_table
from adhesion_jax.report.montecarlo.figures import speed_bars
from adhesion_jax.studies.speed import block_table, recursion_table, timed


def main(repeats: int, seed: int, out: Path) -> None:
    """Time the identifiers; noise and compilation are excluded.

    Whole blocks on he2018-blocks, in identifications per CPU-second; recursions on streams of
    10,000 runs, in samples per CPU-second. The methods take turns, `repeats` times, so that a
    machine whose speed drifts is fair to all; the median is reported.
    """
    directory = output_directory(out)
    recursions = recursion_table(repeats, seed)
    click.echo(recursions.to_string(index=False, float_format=lambda x: f"{x:,.4g}") + "\n")
    with tqdm(total=(repeats + 1) * len(timed(seed)), unit="method") as bar:

        def progress(name: str) -> None:
            bar.set_description(name)
            bar.update()

        table = block_table(repeats, seed, progress)
    with staged(directory, ("speed.csv", "recursions.csv", "speed.png")) as stage:
        write_table(stage / "speed.csv", table)
        write_table(stage / "recursions.csv", recursions)
        speed_bars(stage / "speed.png", table)
    click.echo(table.to_string(index=False, float_format=lambda x: f"{x:,.4g}"))
    click.echo(f"\nwritten to {directory}")
