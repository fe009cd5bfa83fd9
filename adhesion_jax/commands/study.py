"""Measure how often the discovery is right: false claims, detection, confusions, random effects."""

import time
from collections.abc import Mapping
from pathlib import Path

import click
import pandas as pd
from tqdm import tqdm

from adhesion_jax import runtime
from adhesion_jax.files import output_directory, staged, write_metadata, write_table
from adhesion_jax.report.studies.discovery import (
    draw_confusion,
    draw_detection,
    draw_random,
    study_text,
)
from adhesion_jax.studies.discovery.from_tables import discover_tables
from adhesion_jax.studies.discovery.rates import confusion, rates, shares
from adhesion_jax.studies.discovery.running import Discover, run_study
from adhesion_jax.studies.discovery.tasks import study_tasks

OWN_FILES = (
    *("sets.csv", "rates.csv", "confusion.csv", "shares.csv", "metadata.json"),
    *("detection.png", "confusion.png", "random.png"),
)


def main(workers: int, out: Path, **sizes: int) -> None:
    """Run the discovery on simulated sets and count what it gets right."""
    study(sizes, out, discover_tables, workers)


def study(
    sizes: Mapping[str, int], out: Path, discover: Discover, workers: int = 1
) -> pd.DataFrame:
    """The study of any `discover`, written to `out`; its rates.

    `sizes` are the arguments of `study_tasks`.
    """
    tasks = study_tasks(**sizes)
    directory = output_directory(out)
    began = time.perf_counter()
    with staged(directory, OWN_FILES) as stage:
        with tqdm(total=len(tasks), desc=tasks[0].part, unit="set") as bar:

            def progress(part: str) -> None:
                bar.set_description(part)
                bar.update()

            sets = run_study(tasks, discover, progress, workers)
        hits, removed = rates(sets), shares(sets)
        write_table(stage / "sets.csv", sets)
        write_table(stage / "rates.csv", hits)
        parts = {task.part for task in tasks}
        if "confusion" in parts:
            counts = confusion(sets)
            counts.to_csv(stage / "confusion.csv")
            draw_confusion(stage / "confusion.png", counts, hits)
            draw_detection(stage / "detection.png", hits)
        if "random" in parts:
            write_table(stage / "shares.csv", removed)
            draw_random(stage / "random.png", sets)
        metadata = {
            "config": {**sizes, "workers": workers},
            "wall_seconds": time.perf_counter() - began,
            **runtime.describe(),
        }
        write_metadata(stage / "metadata.json", metadata)
    click.echo(study_text(hits, removed, sets))
    click.echo(f"\nwritten to {directory} in {time.perf_counter() - began:.0f} s")
    return hits
