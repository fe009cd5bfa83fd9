"""Measure how often the intervals of an identification hold the true peak."""

import time
from pathlib import Path

import click
from tqdm import tqdm

from adhesion_jax import runtime
from adhesion_jax.command_line.command import Folder, run, start
from adhesion_jax.files import output_directory, staged, write_metadata, write_table
from experiments.intervals.coverage import (
    KNOWN_CELLS,
    UNKNOWN_CELLS,
    coverage_rates,
    coverage_study,
)
from experiments.intervals.report import coverage_text, draw_coverage

OWN_FILES = ("sets.csv", "coverage.csv", "metadata.json", "coverage.png")


@click.command(context_settings={"show_default": True})
@click.option(
    "--sets",
    type=click.IntRange(min=1),
    default=1000,
    help="Record sets of each true curve and noise.",
)
@click.option(
    "--workers",
    type=click.IntRange(min=1),
    default=1,
    help="Processes; the results do not depend on their number.",
)
@click.option(
    "--out",
    type=Folder(),
    default=Path("out/intervals"),
    help="Folder for sets.csv, coverage.csv, metadata.json and coverage.png.",
)
def main(sets: int, workers: int, out: Path) -> None:
    """Count how often the 95 % intervals of the peak hold the true one, over simulated records."""
    start()
    directory, began = output_directory(out), time.perf_counter()
    cells = (*KNOWN_CELLS, *UNKNOWN_CELLS)
    with staged(directory, OWN_FILES) as stage:
        with tqdm(total=sets * len(cells), unit="set", disable=None) as bar:

            def progress(words: str) -> None:
                bar.set_description(words)
                bar.update()

            rows = coverage_study(cells, sets, progress, workers)
        rates = coverage_rates(rows)
        write_table(stage / "sets.csv", rows)
        write_table(stage / "coverage.csv", rates)
        draw_coverage(stage / "coverage.png", rates)
        metadata = {
            "config": {"sets": sets, "workers": workers},
            "wall_seconds": time.perf_counter() - began,
            **runtime.describe(),
        }
        write_metadata(stage / "metadata.json", metadata)
    click.echo(coverage_text(rates))
    click.echo(f"\nWritten to {directory} in {time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    run(main)
