"""How far a job in shards is, and what its finished runs tell."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import click

from adhesion_jax.campaign.identity import surroundings
from adhesion_jax.campaign.notes import notes
from adhesion_jax.campaign.store import FOLDER, is_locked, read_all, recorded, runs_in
from adhesion_jax.commands import montecarlo, traction
from adhesion_jax.errors import InputError

#: By command: what prints the tables of a job, from its record and the folder of its shards.
_TELL: Mapping[str, Callable[[Mapping[str, Any], Path], None]] = {
    "montecarlo": montecarlo.tell_stored,
    "traction": traction.tell_stored,
}

#: What a record or a shard that was changed by hand may lead to.
_DAMAGED = (ArithmeticError, AttributeError, LookupError, MemoryError, TypeError, ValueError)


def main(folder: Path) -> None:
    """Say how far the job in a folder is, and what its finished runs tell."""
    record = recorded(folder)
    if record is None:
        raise InputError(
            f"{folder} holds no job; name the folder (--out) of a command with --resume."
        )
    computing, whole = is_locked(folder), True
    shards = folder / FOLDER
    for job in record["jobs"]:
        try:
            runs = sum(map(runs_in, read_all(shards, job["name"], job["shards"])))
        except _DAMAGED as error:
            raise InputError(
                f"{folder} holds a shard of {job['name']} that is damaged ({error!r}); compute the "
                "job anew."
            ) from None
        whole &= runs == job["runs"]
        share = runs / job["runs"]
        click.echo(f"{job['name']}: {runs} of {job['runs']} runs are finished ({share:.0%})")
        if runs and record["command"] in _TELL:
            _tell(record["command"], job, shards)
    if computing:
        now = "".join(f"\n  {words}" for _, words in notes(shards))
        click.echo(f"\na job is computing in this folder{':' if now else ''}{now}")
    elif not whole:
        click.echo("\nno job is computing in this folder; the same command with --resume goes on")


def _tell(command: str, job: Mapping[str, Any], shards: Path) -> None:
    """What the finished runs of a job tell, or why that cannot be said here.

    Files of the user's own are not needed for it, and not run: a folder may be that of another.
    """
    now = surroundings()
    before = job.get("depends on")
    before = before if isinstance(before, Mapping) else {}
    other = [name for name, value in now.items() if before.get(name) != value]
    if other:
        click.echo(
            f"Its tables cannot be told here: the {other[0]} is another one than where it was "
            "computed."
        )
        return
    try:
        _TELL[command](job, shards)
    except InputError as refusal:  # a scenario of the user's own
        click.echo(f"Its tables cannot be told here: {refusal}")
    except _DAMAGED as error:
        click.echo(f"Its tables cannot be told here: its record is damaged ({error!r}).")
