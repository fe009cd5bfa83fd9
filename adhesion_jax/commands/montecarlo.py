"""Identify thousands of noisy adhesion curves and say how well each method knows them."""

import dataclasses
import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import click
import jax
import numpy as np
import pandas as pd

from adhesion_jax import runtime
from adhesion_jax.campaign.cluster import pool_of
from adhesion_jax.campaign.config import Config, main_job
from adhesion_jax.campaign.job import Job
from adhesion_jax.campaign.monte_carlo import Campaign, Totals, added, campaign_of, suited
from adhesion_jax.campaign.shard import content, reduced_of
from adhesion_jax.campaign.store import read_all, write_rows
from adhesion_jax.files import output_directory, write_metadata, write_table
from adhesion_jax.identifiers import Status
from adhesion_jax.library.shards import compute, extended, opened_for
from adhesion_jax.report.montecarlo import figures
from adhesion_jax.report.montecarlo.tables import accuracy_table, tracking_text
from adhesion_jax.runtime import CORES
from adhesion_jax.scenarios import Options

OWN_FILES = (
    *("summary.csv", "switches.csv", "checkpoints.csv", "runs.parquet", "metadata.json"),
    *("steady.csv", "tracking.csv", "bands.csv"),
    *("histogram_mu_max.png", "tracking.png", "convergence.png", "bands.png"),
)


def main(
    scenario: str | None,
    identifiers: tuple[str, ...],
    runs: int,
    seed: int,
    out: Path,
    keep: str,
    resume: bool,
    extend: int,
    cluster: str | None = None,
    shared_folder: bool = False,
    **options: object,
) -> None:
    """Identify thousands of noisy adhesion curves and compare the methods."""
    directory = output_directory(out)
    if extend:
        runs = extended(directory, extend)
    asked = Config(identifiers=identifiers, options=Options(**options), runs=runs, seed=seed)
    parts = main_job(asked) if scenario is None else [replace(asked, scenario=scenario)]
    jobs = [Job.of(config, every_block=keep == "all") for config in parts]
    began = time.perf_counter()
    with (
        pool_of(CORES, cluster, shared_folder) as pool,
        opened_for("montecarlo", jobs, directory, OWN_FILES, resume, extend) as (folder, stage),
    ):
        compute(content, jobs, folder, partial(suited, pool))
        campaigns = [campaign_of(job, _totals(job, folder)) for job in jobs]
        write_rows(stage / "runs.parquet", folder, jobs)
        tables = _joined([campaign.tables for campaign in campaigns])
        for name, table in tables.items():
            write_table(stage / f"{name}.csv", table)
        _draw(stage, jobs, campaigns, tables)
        metadata = {
            "config": {**_config(asked, parts), "keep": keep},
            "in_force": {job.config.scenario: _in_force(job) for job in jobs},
            "identifiers": {job.config.scenario: job.names for job in jobs},
            "seed": seed,
            "statuses": {status.name.lower(): status.sentence for status in Status},
            "compile_seconds": {
                job.config.scenario: campaign.compile_seconds
                for job, campaign in zip(jobs, campaigns, strict=True)
            },
            "wall_seconds": time.perf_counter() - began,
            **runtime.describe(),
        }
        write_metadata(stage / "metadata.json", metadata)
    tell(tables, runs, [job.config.scenario for job in jobs])
    click.echo(f"\nwritten to {directory} in {time.perf_counter() - began:.0f} s")


def tell(tables: Mapping[str, pd.DataFrame], runs: int, scenarios: Sequence[str]) -> None:
    """Print the tables of a campaign."""
    names = " and ".join(scenarios)
    for name in ("summary", "switches"):
        if name in tables:
            click.echo(f"\n{name}: mu_max over {runs} runs of {names}")
            click.echo(accuracy_table(tables[name]))
    if "tracking" in tables:
        click.echo(f"\ntracking: mu_max over {runs} runs of {names}")
        click.echo(tracking_text(tables["tracking"]))


def tell_stored(record: Mapping[str, Any], folder: Path) -> None:
    """Print the tables of those shards that are there of the job of a record."""
    job = Job.recorded(record)
    totals = _totals(job, folder)
    tell(campaign_of(job, totals).tables, totals.sums.accuracy.runs, [job.name])


def _totals(job: Job, folder: Path) -> Totals:
    """What those shards of a job add up to that are there."""
    return added(job, map(reduced_of, read_all(folder, job.name, job.shards)))


def _config(asked: Config, parts: Sequence[Config]) -> Mapping[str, object]:
    """The command line, a law among the options as what it says."""
    options = dict(asked.options)
    if "law" in options:
        options["law"] = json.loads(options["law"])
    config = {**dataclasses.asdict(replace(asked, options=Options())), "options": options}
    return {**config, "scenario": ",".join(part.scenario for part in parts)}


def _in_force(job: Job) -> dict[str, object]:
    """What the options and the scenario's own defaults come to; the slip is that of one tile."""
    slip = np.asarray(job.tiles.draw(0, 0).slip)
    return {
        "rails": job.scenario.rails,
        **dataclasses.asdict(job.scenario.noise),
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


def _draw(
    stage: Path,
    jobs: Sequence[Job],
    campaigns: Sequence[Campaign],
    tables: Mapping[str, pd.DataFrame],
) -> None:
    densities = [campaign.histogram for campaign in campaigns if len(campaign.histogram)]
    if densities:
        path = stage / "histogram_mu_max.png"
        figures.histogram(path, tables["summary"], pd.concat(densities, ignore_index=True))
    for job, campaign in zip(jobs, campaigns, strict=True):
        scenario = job.scenario
        truth = pd.DataFrame(scenario.quantities())
        truth.insert(0, "block", np.arange(len(truth)))
        for name, reached in scenario.figures():
            path = stage / f"{name}.png"
            if name == "bands":
                steps = jax.eval_shape(scenario.draw, jax.random.key(0)).slip.shape[-1]
                figures.bands(path, truth, campaign.bands, steps)
            elif name == "tracking":
                figures.tracking(path, truth, campaign.bands)
            elif reached is not None:
                figures.convergence(path, tables["checkpoints"], campaign.bands, *reached)
