"""Measure how often the intervals of an identification hold the true peak."""

import time
from pathlib import Path

import click
from tqdm import tqdm

from adhesion_jax import runtime
from adhesion_jax.files import output_directory, staged, write_metadata, write_table
from adhesion_jax.report.studies.intervals import coverage_text, draw_coverage
from adhesion_jax.studies.intervals.coverage import (
    KNOWN_CELLS,
    UNKNOWN_CELLS,
    coverage_rates,
    coverage_study,
)

OWN_FILES = ("sets.csv", "coverage.csv", "metadata.json", "coverage.png")


def main(sets: int, workers: int, out: Path) -> None:
    """Identify `sets` records of each cell, and write how often the truth is held."""
    directory, began = output_directory(out), time.perf_counter()
    cells = (*KNOWN_CELLS, *UNKNOWN_CELLS)
    with staged(directory, OWN_FILES) as stage:
        with tqdm(total=sets * len(cells), unit="set") as bar:

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
    click.echo(f"\nwritten to {directory} in {time.perf_counter() - began:.0f} s")
