"""How far a Monte Carlo job is, and what its finished runs tell."""

from pathlib import Path

import click

from adhesion_jax.campaign.job import shard_count, shard_runs
from adhesion_jax.campaign.monte_carlo import added, campaign_of
from adhesion_jax.campaign.store import FOLDER, is_locked, jobs_of, read, record_of, recorded
from adhesion_jax.commands.montecarlo import tell
from adhesion_jax.errors import InputError


def main(folder: Path) -> None:
    """Say how far the job in a folder is, and what its finished runs tell."""
    record = recorded(folder)
    if record is None:
        raise InputError(
            f"{folder} holds no job; name the folder that adhesion montecarlo writes to (--out)."
        )
    try:
        jobs = jobs_of(record)
        same = record_of(jobs) == record
    except (InputError, KeyError):  # it has names that are not known here
        same = False
    if not same:
        raise InputError(
            f"The job in {folder} was computed by another version of the package or of a library, "
            "or with methods of your own; its shards cannot be read by this one."
        )
    computing, whole = is_locked(folder), True
    for job in jobs:
        numbers = range(shard_count(job))
        there = {n: found for n in numbers if (found := read(folder / FOLDER, job, n)) is not None}
        runs = sum(shard_runs(job, number) for number in there)
        share = runs / job.config.runs
        whole &= runs == job.config.runs
        click.echo(
            f"{job.config.scenario}: {runs} of {job.config.runs} runs are finished ({share:.0%})"
        )
        if there:
            tell(campaign_of(job, added(job, there.values())).tables, runs, [job.config.scenario])
    if computing:
        click.echo("\na job is computing in this folder")
    elif not whole:
        click.echo("\nno job is computing in this folder; the same command with --resume goes on")
