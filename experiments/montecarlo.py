"""Identify thousands of noisy adhesion curves and say how well each method knows them."""

import dataclasses
import time
from collections.abc import Mapping
from pathlib import Path

import click
import jax
import numpy as np
import pandas as pd
from tqdm import tqdm

from adhesion_jax import runtime
from adhesion_jax.campaign.config import Config, build_scenario, choose_identifiers
from adhesion_jax.campaign.monte_carlo import progress_steps, run_campaign
from adhesion_jax.campaign.store import (
    EstimateWriter,
    read_estimates,
    staged,
    write_metadata,
    write_table,
)
from adhesion_jax.identifiers import ABLATIONS, IDENTIFIERS, Status
from adhesion_jax.report import figures
from adhesion_jax.report.tables import accuracy_table
from adhesion_jax.scenarios import SCENARIOS, Options, Scenario
from adhesion_jax.scenarios.growing import GrowingSequence
from adhesion_jax.scenarios.rails import RAILS
from adhesion_jax.scenarios.stream import Stream
from experiments.command import FiniteRange, output_directory, run


def _list(context: click.Context, _: click.Parameter, wanted: bool) -> None:
    if not wanted or context.resilient_parsing:
        return
    click.echo("scenarios")
    for name, build in SCENARIOS.items():
        click.echo(f"  {name:<16}{(build.__doc__ or '').splitlines()[0]}")
    click.echo("identifiers")
    for name in IDENTIFIERS:
        click.echo(f"  {name}{'  (runs when named)' if name in ABLATIONS else ''}")
    click.echo(f"rails\n  {', '.join(RAILS)}")
    context.exit()


OWN_FILES = (
    *("summary.csv", "switches.csv", "checkpoints.csv", "runs.parquet", "metadata.json"),
    *("histogram_mu_max.png", "tracking.png", "convergence.png"),
)


@click.command()
@click.option("--scenario", default="he2018-blocks", show_default=True, help="What is identified.")
@click.option("--identifiers", help="Names divided by commas; by default all that fit.")
@click.option("--rail", help="Rail of a scenario that has one rail.")
@click.option("--sigma", type=FiniteRange(min=0), help="Noise of the adhesion signal (0.01).")
@click.option("--points", type=click.IntRange(min=4), help="Points in a block (500).")
@click.option(
    "--slip-max",
    type=FiniteRange(min=0, max=1, min_open=True),
    help="Largest slip of the excitation.",
)
@click.option(
    "--outliers",
    type=FiniteRange(min=0, max=1, max_open=True),
    help="Share of points with ten times the noise (0).",
)
@click.option("--blocks", type=click.IntRange(min=1), help="Blocks of a run.")
@click.option("--runs", type=click.IntRange(min=1), default=1000, show_default=True)
@click.option("--seed", type=click.IntRange(min=0, max=2**32 - 1), default=0, show_default=True)
@click.option(
    "--out", type=click.Path(path_type=Path), default=Path("out/montecarlo"), show_default=True
)
@click.option(
    "--list",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_list,
    help="Show the names.",
)
def main(
    scenario: str,
    identifiers: str | None,
    rail: str | None,
    sigma: float | None,
    points: int | None,
    slip_max: float | None,
    outliers: float | None,
    blocks: int | None,
    runs: int,
    seed: int,
    out: Path,
) -> None:
    """Identify thousands of noisy adhesion curves and compare the methods."""
    config = Config(
        scenario=scenario,
        identifiers=tuple(name.strip() for name in identifiers.split(",")) if identifiers else (),
        options=Options(rail, sigma, points, slip_max, outliers, blocks),
        runs=runs,
        seed=seed,
    )
    built = build_scenario(config)
    names = choose_identifiers(config, built)
    directory = output_directory(out)
    began = time.perf_counter()
    with staged(directory, OWN_FILES) as stage:
        writer = EstimateWriter(stage / "runs.parquet")
        with tqdm(total=progress_steps(config), desc="compiling", unit="tile") as bar:

            def progress(name: str) -> None:
                bar.set_description(name)
                bar.update()

            campaign = run_campaign(config, writer.append, progress)
        writer.close()
        for name, table in campaign.tables.items():
            write_table(stage / f"{name}.csv", table)
        _draw(stage, built, names, campaign.tables)
        metadata = {
            "config": dataclasses.asdict(config),
            "in_force": _in_force(built),
            "identifiers": names,
            "seed": seed,
            "statuses": {status.name.lower(): status.sentence for status in Status},
            "compile_seconds": campaign.compile_seconds,
            "wall_seconds": time.perf_counter() - began,
            **runtime.describe(),
        }
        write_metadata(stage / "metadata.json", metadata)
    for name in [name for name in campaign.tables if name != "checkpoints"]:
        table = campaign.tables[name]
        click.echo(f"\n{name}: mu_max over {runs} runs of {scenario}")
        click.echo(accuracy_table(table))
    click.echo(f"\nwritten to {directory} in {time.perf_counter() - began:.0f} s")


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


def _draw(
    stage: Path, scenario: Scenario, names: tuple[str, ...], tables: Mapping[str, pd.DataFrame]
) -> None:
    def estimates(identifier: str, columns: list[str]) -> pd.DataFrame:
        return read_estimates(stage / "runs.parquet", columns, identifier)

    pooled = [block for group in scenario.tables()["summary"] for block in group.blocks]
    figures.histogram(stage / "histogram_mu_max.png", tables["summary"], estimates, pooled)
    if isinstance(scenario, GrowingSequence):
        slip = np.asarray(scenario.slip)
        reached, label = (
            [float(slip[length - 1]) for length in scenario.lengths],
            "slip reached (1)",
        )
    if isinstance(scenario, Stream):
        reached, label = [float(length) for length in scenario.lengths], "samples seen (1)"
    if "checkpoints" in tables:
        figures.convergence(
            stage / "convergence.png", tables["checkpoints"], estimates, reached, label
        )
    truth = pd.DataFrame(scenario.quantities())
    truth.insert(0, "block", np.arange(len(truth)))
    figures.tracking(stage / "tracking.png", truth, estimates, list(names))


if __name__ == "__main__":
    run(main)
