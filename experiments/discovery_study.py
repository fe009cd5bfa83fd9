"""Measure how often the discovery is right: false claims, detection by strength, confusions."""

import time
from pathlib import Path

import click
import pandas as pd
from tqdm import tqdm

from adhesion_jax import runtime
from adhesion_jax.discovery.study import Discover, confusion, rates, run_study, study_tasks
from adhesion_jax.errors import InputError
from adhesion_jax.files import staged, write_metadata, write_table
from adhesion_jax.report.discovery_study import draw_confusion, draw_detection, study_text
from experiments.command import output_directory, run
from experiments.discovery_tables import discover_tables

OWN_FILES = (
    *("sets.csv", "rates.csv", "confusion.csv", "metadata.json"),
    *("detection.png", "confusion.png"),
)


@click.command()
@click.option(
    "--null",
    type=click.IntRange(min=0),
    default=200,
    show_default=True,
    help="Sets with nothing hidden in them.",
)
@click.option(
    "--powers",
    type=click.IntRange(min=0),
    default=10,
    show_default=True,
    help="Sets of each effect and strength.",
)
@click.option("--seed", type=click.IntRange(min=0, max=2**32 - 1), default=0, show_default=True)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("out/discovery_study"),
    show_default=True,
)
def main(null: int, powers: int, seed: int, out: Path) -> None:
    """Run the discovery on simulated sets and count what it gets right."""
    study(null, powers, seed, out, discover_tables)


def study(null: int, powers: int, seed: int, out: Path, discover: Discover) -> pd.DataFrame:
    """The study of any `discover`, written to `out`; its rates."""
    tasks = study_tasks(null, powers, seed)
    if not tasks:
        raise InputError("A study of no sets says nothing; give --null or --powers above 0.")
    directory = output_directory(out)
    began = time.perf_counter()
    with staged(directory, OWN_FILES) as stage:
        with tqdm(total=len(tasks), desc=tasks[0].part, unit="set") as bar:

            def progress(part: str) -> None:
                bar.set_description(part)
                bar.update()

            sets = run_study(tasks, discover, progress)
        shares = rates(sets)
        write_table(stage / "sets.csv", sets)
        write_table(stage / "rates.csv", shares)
        if powers:
            counts = confusion(sets)
            counts.to_csv(stage / "confusion.csv")
            draw_confusion(stage / "confusion.png", counts, shares)
            draw_detection(stage / "detection.png", shares)
        metadata = {
            "config": {"null": null, "powers": powers, "seed": seed},
            "wall_seconds": time.perf_counter() - began,
            **runtime.describe(),
        }
        write_metadata(stage / "metadata.json", metadata)
    click.echo(study_text(shares, sets))
    click.echo(f"\nwritten to {directory} in {time.perf_counter() - began:.0f} s")
    return shares


if __name__ == "__main__":
    run(main)
