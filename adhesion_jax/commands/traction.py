"""Run a published traction control system on its plant and judge it."""

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click
import pandas as pd

from adhesion_jax import runtime
from adhesion_jax.campaign.cluster import pool_of
from adhesion_jax.campaign.store import read_all, write_rows
from adhesion_jax.campaign.traction import (
    WHOLE,
    Named,
    added,
    content,
    job_of,
    judged,
    metrics_of,
)
from adhesion_jax.commands.shards import compute, extended, opened_for
from adhesion_jax.files import output_directory, write_metadata, write_table
from adhesion_jax.report.page_html import page_html
from adhesion_jax.report.traction import SUBJECTS
from adhesion_jax.report.traction.operating_point import (
    animate_operating_point,
    draw_operating_point,
)
from adhesion_jax.report.traction.page import traction_page
from adhesion_jax.report.traction.panels import draw
from adhesion_jax.report.traction.runs import Drawing, shown
from adhesion_jax.traction.plants.reading import PlantFile, read_plant, shipped
from adhesion_jax.traction.systems import SYSTEMS
from adhesion_jax.traction.systems.base import with_parts

_POINT = "operating_point"
_POINT_CAPTION = "The operating point over the adhesion curves while the surface changes."

#: The figures that are told on the way.
_TOLD = ("utilisation", "utilisation_se", "tracking_rms", "slip_energy_share", "torque_variation")

#: All that the command may write, of whichever system.
OWN_FILES = (
    *("table.csv", "metrics.csv", "runs.parquet", "metadata.json", "report.html"),
    *(f"{_POINT}.png", f"{_POINT}.gif"),
    *(f"{name}.png" for subject in SUBJECTS.values() for name in subject.captions),
)


def main(
    name: str,
    plant_name: str | None,
    observer: str | None,
    seeker: str | None,
    controller: str | None,
    runs: int,
    seed: int,
    step: float | None,
    animate: bool,
    workers: int | None,
    resume: bool,
    extend: int,
    out: Path,
    cluster: str | None = None,
    shared_folder: bool = False,
) -> None:
    """Run a published control system on its plant: its table, its figures and its metrics.

    Every scenario of the paper runs once without noise and `--runs` times with noise. With an
    observer, a seeker or a controller named, it takes the place of the paper's own.
    """
    began = time.perf_counter()
    system, subject = SYSTEMS[name], SUBJECTS[name]
    system = system._replace(step=step or system.step)
    plant = _plant(plant_name or system.plant)
    cases = with_parts(system.cases(system.step), observer, seeker, controller)
    if extend:
        runs = extended(out, extend)
    asked = {
        "--system": name,
        "--plant": plant_name or system.plant,
        "--observer": observer or "of the paper",
        "--seeker": seeker or "of the paper",
        "--controller": controller or "of the paper",
        "--step": f"{system.step:g}",
    }
    job = job_of(name, system, cases, plant.plant, runs, seed, asked)
    directory = output_directory(out)
    with (
        pool_of(workers or runtime.CORES, cluster, shared_folder) as pool,
        opened_for("traction", [job], directory, OWN_FILES, resume, extend) as (folder, stage),
    ):
        compute(content, [job], folder, lambda _: pool)
        found = judged(job, read_all(folder, job.name, job.shards))
        write_rows(stage / "runs.parquet", folder, [job])
        table = subject.table(found.metrics)
        write_table(stage / "table.csv", table)
        write_table(stage / "metrics.csv", found.metrics)
        runs_shown = [shown(*pair) for pair in zip(cases, found.traces, strict=True)]
        captions = {}
        for figure, panels in subject.figures(Drawing(runs_shown, plant.plant)).items():
            if panels:
                draw(stage / f"{figure}.png", panels)
                captions[f"{figure}.png"] = subject.captions[figure]
        draw_operating_point(stage / f"{_POINT}.png", runs_shown[0])
        captions[f"{_POINT}.png"] = _POINT_CAPTION
        if animate:
            animate_operating_point(stage / f"{_POINT}.gif", runs_shown[0])
        page = traction_page(system, plant, table, found.metrics, captions, runs)
        pictures = {picture: (stage / picture).read_bytes() for picture in captions}
        (stage / "report.html").write_text(page_html(page, pictures), encoding="utf-8")
        seconds = time.perf_counter() - began
        write_metadata(
            stage / "metadata.json",
            {
                "system": name,
                "source": system.source,
                "plant": plant.title,
                "parameters": {key: given._asdict() for key, given in plant.given.items()},
                "observer": observer,
                "seeker": seeker,
                "controller": controller,
                "runs": runs,
                "seed": seed,
                "step_s": system.step,
                "control_period_s": system.control_period or system.step,
                "plant_steps": found.steps,
                "plant_steps_per_cpu_second": found.steps / found.seconds,
                "seconds": seconds,
                "compile_seconds": found.compile_seconds,
                "run_cpu_seconds": found.seconds,
                **runtime.describe(),
            },
        )
    click.echo(_aligned(table))
    rate = found.steps / found.seconds / 1e6
    click.echo(
        f"\n{found.steps:.3g} plant steps in {found.seconds:.0f} CPU-seconds "
        f"({rate:.1f} million a CPU-second), compiled in {found.compile_seconds:.0f} s; "
        f"written to {directory} in {seconds:.0f} s"
    )


def tell_stored(record: Mapping[str, Any], folder: Path) -> None:
    """Print the figures of those runs that are there of the job of a record."""
    cases = [Named(**case) for case in record["cases"]]
    metrics = metrics_of(cases, added(read_all(folder, record["name"], record["shards"])))
    shown = metrics[metrics["segment"] == WHOLE]
    columns = ["scenario", "method", "noise", *_TOLD, "status"]
    click.echo("\nmeans over the finished runs, of the whole run each")
    click.echo(_aligned(shown[columns]))


def _plant(name: str) -> PlantFile:
    """The plant of a file, or of the name of one that ships."""
    return read_plant(shipped().get(name, Path(name)))


def _aligned(table: pd.DataFrame) -> str:
    return table.to_string(index=False, float_format=lambda x: f"{x:.4g}", na_rep="")
