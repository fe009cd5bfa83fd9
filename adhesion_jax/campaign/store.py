"""Shards on disk: each is there whole or not at all, whatever ended the process that computed it.

A shard is a part of a job that one process computes, a function of the job and of its number
alone. It has two files, its rows (parquet) and what the runs add up to (npz). The second gets its
name last and holds the checksum of the first: a shard is there if both agree. `job.json` says what
was computed. The folder is locked while a job computes.

For those who wait there are notes on the shards that are being computed: the runs done and what
goes on. A note is a small file beside the shards, which begins as what is not complete does.
Nothing depends on it: one that cannot be written or read is left out.
"""

import io
import json
import os
import shutil
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple, Protocol, TypeVar, runtime_checkable
from zipfile import BadZipFile

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from filelock import FileLock, Timeout
from numpy.typing import NDArray

from adhesion_jax.campaign.identity import own_files, surroundings
from adhesion_jax.campaign.rows import row_schema
from adhesion_jax.errors import InputError

#: What begins with this is not complete yet, or was left by a job that was killed.
PARTIAL = ".partial-"

_NOTE = f"{PARTIAL}note-"

#: Seconds between two notes on the same thing.
_PAUSE = 0.5

#: Takes the number of runs that are done, and words on what goes on.
Tell = Callable[[int, str], None]


@contextmanager
def noting(folder: Path, shard: str) -> Iterator[Tell]:
    """Keep a note on a shard while it is computed: new words at once, numbers now and then."""
    path, told, last = folder / f"{_NOTE}{shard}", set[str](), 0.0

    def tell(runs: int, words: str) -> None:
        nonlocal last
        now = time.monotonic()
        if words not in told or now - last > _PAUSE:
            told.add(words)
            last = now
            with suppress(OSError):
                path.write_text(f"{runs} {words}", encoding="utf-8")

    try:
        yield tell
    finally:
        with suppress(OSError):
            path.unlink()


def notes(folder: Path) -> list[tuple[int, str]]:
    """The runs done and the words on what goes on of every shard that is being computed.

    Workers of a cluster have folders of their own in that of the shards; of those that send what
    they store there are no notes.
    """
    found = []
    paths = [
        Path(where, name)
        for where, _, names in os.walk(folder)  # which passes over a folder that vanishes
        for name in names
        if name.startswith(_NOTE)
    ]
    for path in sorted(paths):
        with suppress(OSError, ValueError):
            runs, _, words = path.read_text(encoding="utf-8").partition(" ")
            found.append((int(runs), words))
    return found


#: The folder of the shards within that of the results.
FOLDER = "shards"

_JOB = "job.json"
_LOCK = ".lock"

#: The most shards of a job: their numbers have six digits.
_MOST_SHARDS = 10**6

#: Number of characters of a value that are told where two jobs differ.
_TOLD = 60

#: The number of runs of a shard and the checksum of its rows, among its arrays.
_RUNS, _ROWS = "runs", "checksum of the rows"

#: Numbers by name.
Arrays = Mapping[str, NDArray[Any]]


@runtime_checkable
class Job(Protocol):
    """What is computed in shards: what has to be known of it here."""

    @property
    def name(self) -> str:
        """The word that the names of its files begin with."""

    @property
    def runs(self) -> int:
        """As many as were asked for."""

    @property
    def shards(self) -> int:
        """The number of shards that have all the runs."""

    @property
    def record(self) -> Mapping[str, Any]:
        """What it is, in the words of JSON, with what its numbers rest on under "depends on".

        What all jobs rest on, the package, the libraries and the machine, is added here.
        """

    def runs_of(self, number: int) -> int:
        """The number of runs of a shard."""


class Content(NamedTuple):
    """What is stored of a shard: what its runs add up to, and a row for each that is kept."""

    arrays: Arrays
    rows: pa.Table


#: A kind of job.
J = TypeVar("J", bound=Job)


@contextmanager
def opened(
    directory: Path, command: str, jobs: Sequence[Job], resume: bool, extend: int = 0
) -> Iterator[Path]:
    """The folder of the shards of some jobs of a command, of this process alone.

    What an earlier job has left is removed or, if asked, resumed: InputError if that was another
    job, if another process computes in the folder, or if a job has more shards than can be
    resumed. The runs are `extend` more than the earlier job had.
    """
    for job in jobs:
        if job.shards > _MOST_SHARDS:
            raise InputError(
                f"--runs {job.runs} of {job.name} are {job.shards} shards, and a folder holds "
                f"{_MOST_SHARDS}; ask for fewer runs."
            )
    folder = directory / FOLDER
    folder.mkdir(exist_ok=True)
    try:
        with FileLock(folder / _LOCK, timeout=1):
            try:
                before, asked = recorded(directory), record_of(command, jobs)
                if resume and before is None and any(folder.glob("*.npz")):
                    raise InputError(
                        f"--out {directory} holds shards, and {FOLDER}/{_JOB} there does not say "
                        "of which job; name another folder, or leave --resume out to replace them."
                    )
                _clear(folder, PARTIAL)
                if before is None or not resume:
                    _clear(folder, "")
                else:
                    _refuse_other(directory, before, {**asked, "runs": asked["runs"] - extend})
                write(folder / _JOB, (json.dumps(asked, indent=2) + "\n").encode())
                yield folder
            finally:
                _clear(folder, PARTIAL)
                if not any(folder.glob("*.npz")):
                    shutil.rmtree(folder, ignore_errors=True)
    except Timeout:
        raise InputError(
            f"--out {directory} is being written to by another job; "
            "wait until it is done, or name another folder."
        ) from None


def _clear(folder: Path, prefix: str) -> None:
    """Remove all in the folder whose names begin so, the lock apart."""
    for path in folder.iterdir():
        if path.name.startswith(prefix) and path.name != _LOCK:
            if path.is_dir():
                shutil.rmtree(path)
            else:
                path.unlink()


def record_of(command: str, jobs: Sequence[Job]) -> Mapping[str, Any]:
    """What the jobs of a command are, in the words of JSON."""
    every = {**surroundings(), **own_files()}
    described = [
        {
            "name": job.name,
            "shards": job.shards,
            "runs": sum(job.runs_of(number) for number in range(job.shards)),
            **(record := job.record),
            "depends on": {**record["depends on"], **every},
        }
        for job in jobs
    ]
    return {"command": command, "runs": jobs[0].runs, "jobs": described}


def recorded(directory: Path) -> Mapping[str, Any] | None:
    """What was computed in the folder of some results, if anything that can be told."""
    try:
        found: Mapping[str, Any] = json.loads((directory / FOLDER / _JOB).read_text())
        whole = isinstance(found["command"], str) and all(map(_is_job, found["jobs"]))
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None
    return found if whole else None


def _is_job(record: Mapping[str, Any]) -> bool:
    """Whether a job of a record says what all of them do, of a size that a folder can hold."""
    runs, shards = record["runs"], record["shards"]
    counts = type(runs) is int and type(shards) is int and runs > 0 and 0 < shards <= _MOST_SHARDS
    name = record["name"]
    return counts and isinstance(name, str) and Path(name).name == name


def is_locked(directory: Path) -> bool:
    """Whether a job computes in the folder now."""
    try:
        with FileLock(directory / FOLDER / _LOCK, timeout=0):
            return False
    except Timeout:
        return True


def _refuse_other(directory: Path, before: Mapping[str, Any], asked: Mapping[str, Any]) -> None:
    """InputError that names the first difference between two jobs."""
    there, here = _flat_record(before), _flat_record(asked)
    for name in dict.fromkeys([*there, *here]):
        if there.get(name) != here.get(name):
            one, other = (str(x.get(name, "not given")) for x in (there, here))
            short = max(len(one), len(other)) <= _TOLD
            values = f"is {one} there and {other} here" if short else "is another one"
            raise InputError(
                f"--out {directory} holds another job: {name} {values}. Name another folder, or "
                "leave --resume and --extend out to replace that job."
            )


def _flat_record(record: Mapping[str, Any]) -> dict[str, Any]:
    """All that two jobs may differ in, by what a user calls it."""
    flat = {"the command": record.get("command")}
    flat["what is computed"] = ",".join(job.get("name", "?") for job in record["jobs"])
    several = len(record["jobs"]) > 1
    for job in record["jobs"]:
        for key, value in job["depends on"].items():
            flat[f"{key} of {job['name']}" if several else key] = value
    return {**flat, "--runs": record["runs"]}


def missing(folder: Path, jobs: Sequence[J]) -> list[tuple[J, int]]:
    """The shards that are not there, not whole, or have other runs: jobs and numbers."""
    return [
        (job, number)
        for job in jobs
        for number in range(job.shards)
        if (found := read(folder, job.name, number)) is None or found[_RUNS] != job.runs_of(number)
    ]


def stored(content: Callable[[J, int, Tell], Content], job: J, number: int, folder: Path) -> int:
    """Compute the content of a shard and store it; the number of its runs."""
    with noting(folder, f"{job.name}-{number}") as tell:
        arrays, table = content(job, number, tell)
    sums, rows = _paths(folder, job.name, number)
    sink = pa.BufferOutputStream()
    with _writer(sink, table.schema) as writer:
        writer.write_table(table)
    written = sink.getvalue().to_pybytes()
    write(rows, written)
    stream, runs = io.BytesIO(), job.runs_of(number)
    checksum = np.frombuffer(sha256(written).digest(), dtype=np.uint8)
    every: dict[str, Any] = {**arrays, _RUNS: np.array(runs), _ROWS: checksum}
    np.savez(stream, **every)
    write(sums, stream.getvalue())
    return runs


def read(folder: Path, name: str, number: int) -> Arrays | None:
    """The arrays of a shard of the job of this name; None if it is not there or not whole."""
    sums, rows = _paths(folder, name, number)
    try:
        with np.load(io.BytesIO(sums.read_bytes())) as stored:  # an archive with checksums
            arrays = {key: stored[key] for key in stored.files}
        return arrays if arrays[_ROWS].tobytes() == sha256(rows.read_bytes()).digest() else None
    except (OSError, BadZipFile, ValueError, KeyError, EOFError):
        return None


def read_all(folder: Path, name: str, shards: int) -> Iterator[Arrays]:
    """The arrays of those of the first shards of a job that are there, in their order."""
    every = (read(folder, name, number) for number in range(shards))
    return (arrays for arrays in every if arrays is not None)


def runs_in(arrays: Arrays) -> int:
    """The number of runs of a shard that was read."""
    return int(arrays[_RUNS])


def rows_of(folder: Path, name: str, number: int) -> pa.Table:
    """The rows of a shard."""
    _, path = _paths(folder, name, number)
    words = [field.name for field in pq.read_schema(path) if field.type == pa.string()]
    return pq.read_table(path, read_dictionary=words)


def write_rows(path: Path, folder: Path, jobs: Sequence[Job]) -> None:
    """The rows of all shards in one file, a row group a shard."""
    schema = row_schema([rows_of(folder, job.name, 0).schema for job in jobs])
    with _writer(path, schema) as writer:
        for job in jobs:
            for number in range(job.shards):
                rows = rows_of(folder, job.name, number)
                for field in schema:
                    if field.name not in rows.column_names:
                        rows = rows.append_column(field, pa.nulls(len(rows), field.type))
                writer.write_table(rows.select(schema.names))


def _writer(where: Any, schema: pa.Schema) -> pq.ParquetWriter:
    """Numbers hardly repeat, words do: only these are worth a dictionary."""
    words = [field.name for field in schema if pa.types.is_dictionary(field.type)]
    return pq.ParquetWriter(
        where, schema, compression="zstd", use_dictionary=words, store_schema=False
    )


def _paths(folder: Path, name: str, number: int) -> tuple[Path, Path]:
    return folder / f"{name}-{number:05}.npz", folder / f"{name}-{number:05}.parquet"


def write(path: Path, content: bytes) -> None:
    """Write a file whole or not at all."""
    partly = path.with_name(f"{PARTIAL}{path.name}")
    partly.write_bytes(content)
    os.replace(partly, path)
