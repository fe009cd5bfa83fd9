"""Measure how often the discovery is right: false claims, detection, confusions, random effects."""

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click
import pandas as pd

from adhesion_jax import runtime
from adhesion_jax.campaign.cluster import pool_of
from adhesion_jax.commands.shards import compute, opened_for
from adhesion_jax.errors import InputError
from adhesion_jax.files import output_directory, write_metadata, write_table
from adhesion_jax.report.studies.discovery import (
    draw_confusion,
    draw_detection,
    draw_random,
    study_text,
)
from adhesion_jax.studies.discovery.from_tables import discover_tables
from adhesion_jax.studies.discovery.rates import confusion, rates, shares
from adhesion_jax.studies.discovery.running import Discover, Study, content, sets_of
from adhesion_jax.studies.discovery.tasks import study_tasks

OWN_FILES = (
    *("sets.csv", "rates.csv", "confusion.csv", "shares.csv", "metadata.json"),
    *("detection.png", "confusion.png", "random.png"),
)


def main(
    workers: int,
    resume: bool,
    out: Path,
    cluster: str | None = None,
    shared_folder: bool = False,
    **sizes: int,
) -> None:
    """Run the discovery on simulated sets and count what it gets right."""
    study(sizes, out, discover_tables, workers, resume, cluster, shared_folder)


def study(
    sizes: Mapping[str, int],
    out: Path,
    discover: Discover,
    workers: int = 1,
    resume: bool = False,
    cluster: str | None = None,
    shared_folder: bool = False,
) -> pd.DataFrame:
    """The study of any `discover`, written to `out`; its rates.

    `sizes` are the arguments of `study_tasks`. Where other processes compute, they must be able to
    import `discover`; the rows are the same, save the times.
    """
    tasks = study_tasks(**sizes)
    if not tasks:
        raise InputError("A study of no sets says nothing; give --null or --powers above 0.")
    directory = output_directory(out)
    began = time.perf_counter()
    job = Study(tuple(tasks), discover, sizes)
    with (
        pool_of(workers, cluster, shared_folder) as pool,
        opened_for("study", [job], directory, OWN_FILES, resume) as (folder, stage),
    ):
        compute(content, [job], folder, lambda _: pool, "set")
        sets = sets_of(folder, job.name, job.shards)
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


def tell_stored(record: Mapping[str, Any], folder: Path) -> None:
    """Print the rates over those sets that are there of the job of a record."""
    sets = sets_of(folder, record["name"], record["shards"])
    click.echo(study_text(rates(sets), shares(sets), sets))
