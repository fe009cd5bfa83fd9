"""Identify thousands of noisy adhesion curves and say how well each method knows them."""

import dataclasses
import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import click
import jax
import numpy as np
import pandas as pd
from tqdm import tqdm

from adhesion_jax import runtime
from adhesion_jax.campaign.config import Config, build_scenario, choose_identifiers, main_job
from adhesion_jax.campaign.monte_carlo import progress_steps, run_campaigns
from adhesion_jax.campaign.rows import row_columns
from adhesion_jax.campaign.store import EstimateWriter, read_estimates
from adhesion_jax.campaign.tiles import draw_tile
from adhesion_jax.files import output_directory, staged, write_metadata, write_table
from adhesion_jax.identifiers import Status
from adhesion_jax.report.montecarlo import figures
from adhesion_jax.report.montecarlo.tables import accuracy_table, tracking_text
from adhesion_jax.scenarios import Options, Scenario
from adhesion_jax.scenarios.growing import GrowingSequence
from adhesion_jax.scenarios.stream import Stream

OWN_FILES = (
    *("summary.csv", "switches.csv", "checkpoints.csv", "runs.parquet", "metadata.json"),
    *("steady.csv", "tracking.csv", "bands.csv"),
    *("histogram_mu_max.png", "tracking.png", "convergence.png", "bands.png"),
)


class Job(NamedTuple):
    """One scenario of the job, and what runs on it."""

    config: Config
    scenario: Scenario
    identifiers: tuple[str, ...]

    @staticmethod
    def of(config: Config) -> "Job":
        scenario = build_scenario(config)
        return Job(config, scenario, choose_identifiers(config, scenario))

    @property
    def name(self) -> str:
        return self.config.scenario


def main(
    scenario: str | None,
    identifiers: tuple[str, ...],
    runs: int,
    seed: int,
    out: Path,
    **options: object,
) -> None:
    """Identify thousands of noisy adhesion curves and compare the methods."""
    asked = Config(identifiers=identifiers, options=Options(**options), runs=runs, seed=seed)
    parts = main_job(asked) if scenario is None else [replace(asked, scenario=scenario)]
    jobs = [Job.of(config) for config in parts]
    directory = output_directory(out)
    began = time.perf_counter()
    with staged(directory, OWN_FILES) as stage:
        columns = row_columns([job.scenario for job in jobs])
        writer = EstimateWriter(stage / "runs.parquet", columns)
        with tqdm(total=sum(map(progress_steps, parts)), desc="compiling", unit="tile") as bar:

            def progress(name: str) -> None:
                bar.set_description(name)
                bar.update()

            campaigns = run_campaigns(parts, writer.append, progress)
        writer.close()
        tables = _joined([campaign.tables for campaign in campaigns])
        for name, table in tables.items():
            write_table(stage / f"{name}.csv", table)
        _draw(stage, jobs, tables)
        metadata = {
            "config": _config(asked, parts),
            "in_force": {job.name: _in_force(job) for job in jobs},
            "identifiers": {job.name: job.identifiers for job in jobs},
            "seed": seed,
            "statuses": {status.name.lower(): status.sentence for status in Status},
            "compile_seconds": {
                job.name: campaign.compile_seconds
                for job, campaign in zip(jobs, campaigns, strict=True)
            },
            "wall_seconds": time.perf_counter() - began,
            **runtime.describe(),
        }
        write_metadata(stage / "metadata.json", metadata)
    names = " and ".join(job.name for job in jobs)
    for name in ("summary", "switches"):
        if name in tables:
            click.echo(f"\n{name}: mu_max over {runs} runs of {names}")
            click.echo(accuracy_table(tables[name]))
    if "tracking" in tables:
        click.echo(f"\ntracking: mu_max over {runs} runs of {names}")
        click.echo(tracking_text(tables["tracking"]))
    click.echo(f"\nwritten to {directory} in {time.perf_counter() - began:.0f} s")


def _config(asked: Config, parts: Sequence[Config]) -> Mapping[str, object]:
    """The command line, a law among the options as what it says."""
    options = dict(asked.options)
    if "law" in options:
        options["law"] = json.loads(options["law"])
    config = {**dataclasses.asdict(replace(asked, options=Options())), "options": options}
    return {**config, "scenario": ",".join(part.scenario for part in parts)}


def _in_force(job: Job) -> dict[str, object]:
    """What the options and the scenario's own defaults come to; the slip is that of one tile."""
    slip = np.asarray(draw_tile(job.config, 0).slip)
    return {
        "rails": job.scenario.rails,
        "sigma": job.scenario.sigma,
        "outliers": job.scenario.outliers,
        "points": slip.shape[-1],
        "slip_max": float(slip.max()),
    }


def _joined(campaigns: Sequence[Mapping[str, pd.DataFrame]]) -> dict[str, pd.DataFrame]:
    """Tables of the same name one below the other."""
    names = dict.fromkeys(name for tables in campaigns for name in tables)
    return {
        name: pd.concat([tables[name] for tables in campaigns if name in tables], ignore_index=True)
        for name in names
    }


def _draw(stage: Path, jobs: Sequence[Job], tables: Mapping[str, pd.DataFrame]) -> None:
    def estimates(identifier: str, columns: list[str]) -> pd.DataFrame:
        return read_estimates(stage / "runs.parquet", columns, identifier)

    pooled = {
        job.name: [b for group in job.scenario.tables()["summary"] for b in group.blocks]
        for job in jobs
        if "mu_max" in job.scenario.quantities()
    }
    if pooled:
        figures.histogram(stage / "histogram_mu_max.png", tables["summary"], estimates, pooled)
    for job in jobs:
        scenario, identifiers = job.scenario, job.identifiers
        truth = pd.DataFrame(scenario.quantities())
        truth.insert(0, "block", np.arange(len(truth)))
        if scenario.known.by_sample:
            steps = jax.eval_shape(scenario.draw, jax.random.key(0)).slip.shape[-1]
            of_job = tables["bands"][tables["bands"]["scenario"] == job.name]
            figures.bands(stage / "bands.png", truth, of_job, steps)
            continue
        if len(truth) > 1:  # a single block has no course
            figures.tracking(stage / "tracking.png", truth, estimates, list(identifiers))
        if isinstance(scenario, GrowingSequence):
            slip = np.asarray(scenario.slip)
            reached = [float(slip[length - 1]) for length in scenario.lengths]
            label = "slip reached (1)"
        elif isinstance(scenario, Stream):
            reached, label = [float(length) for length in scenario.lengths], "samples seen (1)"
        else:
            continue
        path = stage / "convergence.png"
        figures.convergence(path, tables["checkpoints"], estimates, reached, label)
