"""Identify thousands of noisy adhesion curves and say how well each method knows them."""

import dataclasses
import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import click
import jax
import numpy as np
import pandas as pd
from tqdm import tqdm

from adhesion_jax import runtime
from adhesion_jax.campaign.config import (
    MAIN_JOB,
    Config,
    build_scenario,
    choose_identifiers,
    main_job,
)
from adhesion_jax.campaign.monte_carlo import progress_steps, run_campaigns
from adhesion_jax.campaign.rows import row_columns
from adhesion_jax.campaign.store import EstimateWriter, read_estimates
from adhesion_jax.commands.command import FiniteRange, Folder, output_directory
from adhesion_jax.errors import InputError
from adhesion_jax.files import staged, write_metadata, write_table
from adhesion_jax.identifiers import ABLATIONS, IDENTIFIERS, Status
from adhesion_jax.report.montecarlo import figures
from adhesion_jax.report.montecarlo.tables import accuracy_table, tracking_text
from adhesion_jax.scenarios import SCENARIOS, Options, Scenario
from adhesion_jax.scenarios.growing import GrowingSequence
from adhesion_jax.scenarios.options import Declared, declared
from adhesion_jax.scenarios.rails import RAILS
from adhesion_jax.scenarios.stream import Stream


def _list(context: click.Context, _: click.Parameter, wanted: bool) -> None:
    if not wanted or context.resilient_parsing:
        return
    width = max(map(len, SCENARIOS)) + 2
    click.echo("scenarios")
    for name, build in SCENARIOS.items():
        click.echo(f"  {name:<{width}}{(build.__doc__ or '').splitlines()[0]}")
    click.echo("identifiers")
    for name in IDENTIFIERS:
        click.echo(f"  {name}{'  (runs when named)' if name in ABLATIONS else ''}")
    click.echo(f"rails\n  {', '.join(RAILS)}")
    context.exit()


OWN_FILES = (
    *("summary.csv", "switches.csv", "checkpoints.csv", "runs.parquet", "metadata.json"),
    *("steady.csv", "tracking.csv", "bands.csv"),
    *("histogram_mu_max.png", "tracking.png", "convergence.png", "bands.png"),
)


class Job(NamedTuple):
    """One scenario of the job, and what runs on it."""

    name: str
    scenario: Scenario
    identifiers: tuple[str, ...]

    @staticmethod
    def of(config: Config) -> "Job":
        scenario = build_scenario(config)
        return Job(config.scenario, scenario, choose_identifiers(config, scenario))


def scenario_options(command: Callable[..., None]) -> Callable[..., None]:
    """The command with an option for every argument that some scenario takes."""
    known: dict[str, Declared] = {}
    takers: dict[str, list[str]] = {}
    for scenario, build in SCENARIOS.items():
        for name, one in declared(build).items():
            known.setdefault(name, one)
            takers.setdefault(name, []).append(scenario)
    for name, one in reversed(known.items()):
        whose = "" if len(takers[name]) == len(SCENARIOS) else f" For {', '.join(takers[name])}."
        flag = f"--{name.replace('_', '-')}"
        command = click.option(flag, type=_type(one), help=one.option.help + whose)(command)
    return command


def _type(one: Declared) -> click.ParamType | type:
    option = one.option
    if option.is_file:
        return click.Path(path_type=Path)
    if one.kind is int:
        return click.IntRange(
            int(option.low or 0), None if option.high is None else int(option.high)
        )
    if one.kind is float:
        return FiniteRange(option.low, option.high, option.low_open, option.high_open)
    return one.kind


@click.command()
@click.option("--scenario", help=f"What is identified (by default {' and '.join(MAIN_JOB)}).")
@click.option("--identifiers", help="Names divided by commas; by default all that fit.")
@scenario_options
@click.option("--runs", type=click.IntRange(min=1), default=1000, show_default=True)
@click.option("--seed", type=click.IntRange(min=0, max=2**32 - 1), default=0, show_default=True)
@click.option("--out", type=Folder(), default=Path("out/montecarlo"), show_default=True)
@click.option(
    "--list",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_list,
    help="Show the names.",
)
def main(
    scenario: str | None,
    identifiers: str | None,
    runs: int,
    seed: int,
    out: Path,
    **options: object,
) -> None:
    """Identify thousands of noisy adhesion curves and compare the methods."""
    asked = Config(
        identifiers=tuple(name.strip() for name in identifiers.split(","))
        if identifiers is not None
        else (),
        options=Options(
            **{
                name: _text(name, value) if isinstance(value, Path) else value
                for name, value in options.items()
            }
        ),
        runs=runs,
        seed=seed,
    )
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
            "in_force": {job.name: _in_force(job.scenario) for job in jobs},
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


def _text(option: str, path: Path) -> str:
    """What stands in the file of an option; InputError where it cannot be read."""
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        reason = error.strerror
    except UnicodeDecodeError:
        reason = "it is no text"
    raise InputError(f"--{option} {path} cannot be read ({reason}); name another file.") from None


def _config(asked: Config, parts: Sequence[Config]) -> Mapping[str, object]:
    """The command line, a law among the options as what it says."""
    options = dict(asked.options)
    if "law" in options:
        options["law"] = json.loads(options["law"])
    config = {**dataclasses.asdict(replace(asked, options=Options())), "options": options}
    return {**config, "scenario": ",".join(part.scenario for part in parts)}


def _in_force(scenario: Scenario) -> dict[str, object]:
    """What the options and the scenario's own defaults come to."""
    slip = scenario.draw(jax.random.key(0)).slip
    return {
        "rails": scenario.rails,
        "sigma": scenario.sigma,
        "outliers": scenario.outliers,
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
    for name, scenario, identifiers in jobs:
        truth = pd.DataFrame(scenario.quantities())
        truth.insert(0, "block", np.arange(len(truth)))
        if scenario.known.by_sample:
            steps = np.asarray(scenario.draw(jax.random.key(0)).slip).shape[-1]
            of_job = tables["bands"][tables["bands"]["scenario"] == name]
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
