"""How far a job in shards is, and what its finished runs tell."""

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from adhesion_jax.campaign.identity import surroundings
from adhesion_jax.campaign.store import FOLDER, is_locked, notes, read_all, recorded, runs_in
from adhesion_jax.errors import InputError
from adhesion_jax.library import montecarlo, traction

#: By command: the tables of a job as text, from its record and the folder of its shards.
_TABLES: Mapping[str, Callable[[Mapping[str, Any], Path], str]] = {
    "montecarlo": montecarlo.stored_tables,
    "traction": traction.stored_tables,
}

#: What a record or a shard that was changed by hand may lead to.
_DAMAGED = (ArithmeticError, AttributeError, LookupError, MemoryError, TypeError, ValueError)


def status(folder: Path) -> str:
    """How far the job in a folder is, and what its finished runs tell, for a terminal.

    InputError where there is no job, or where a shard is damaged.
    """
    return "\n".join(_lines(folder))


def _lines(folder: Path) -> Iterator[str]:
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
        yield f"{job['name']}: {runs} of {job['runs']} runs are finished ({share:.0%})"
        if runs and record["command"] in _TABLES:
            yield _tables(record["command"], job, shards)
    if computing:
        now = "".join(f"\n  {words}" for _, words in notes(shards))
        yield f"\na job is computing in this folder{':' if now else ''}{now}"
    elif not whole:
        yield "\nno job is computing in this folder; the same command with --resume goes on"


def _tables(command: str, job: Mapping[str, Any], shards: Path) -> str:
    """What the finished runs of a job tell, or why that cannot be said here.

    Files of the user's own are not needed for it, and not run: a folder may be that of another.
    """
    before = job.get("depends on")
    before = before if isinstance(before, Mapping) else {}
    other = [name for name, value in surroundings().items() if before.get(name) != value]
    cannot = "Its tables cannot be told here:"
    if other:
        return f"{cannot} the {other[0]} is another one than where it was computed."
    try:
        return _TABLES[command](job, shards)
    except InputError as refusal:  # a scenario of the user's own
        return f"{cannot} {refusal}"
    except _DAMAGED as error:
        return f"{cannot} its record is damaged ({error!r})."
