"""Identify thousands of noisy adhesion curves and say how well each method knows them."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click
import pandas as pd

from adhesion_jax.campaign.job import Job
from adhesion_jax.campaign.monte_carlo import campaign_of
from adhesion_jax.library.montecarlo import montecarlo, totals_of
from adhesion_jax.options import Options, check, declared
from adhesion_jax.report.montecarlo.tables import accuracy_table, tracking_text
from adhesion_jax.runtime import CORES
from adhesion_jax.scenarios import SCENARIOS


def main(
    scenario: str | None, identifiers: tuple[str, ...], job: Mapping[str, Any], **options: Any
) -> None:
    """Identify thousands of noisy adhesion curves and say how well each method knows them."""
    if scenario is not None:  # one of the user's own is known only now
        check(scenario, declared(SCENARIOS[scenario]), Options(**options))
    workers = job["workers"] or CORES
    found = montecarlo(scenario, identifiers or None, **{**job, "workers": workers}, **options)
    tell(found.tables, found.asked.runs, [one.name for one in found.jobs])
    click.echo(f"\nWritten to {job['out']} in {found.seconds:.0f} s")


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
    totals = totals_of(job, folder)
    tell(campaign_of(job, totals).tables, totals.sums.accuracy.runs, [job.name])
