"""Shards on disk: each is there whole or not at all, whatever ended the process that computed it.

A shard has two files, its rows (parquet) and what the runs add up to (npz). The second gets its
name last and holds the checksum of the first: a shard is there if both agree. `job.json` says what
was computed. The folder is locked while a job computes.
"""

import io
import json
import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from filelock import FileLock, Timeout

from adhesion_jax.campaign.config import Config
from adhesion_jax.campaign.job import Job, description, shard_count, shard_runs
from adhesion_jax.campaign.rows import WORDS, row_schema
from adhesion_jax.campaign.shard import Reduced, Sums, shard
from adhesion_jax.errors import InputError
from adhesion_jax.metrics.moments import Moments
from adhesion_jax.scenarios import Options

#: The folder of the shards within that of the results.
FOLDER = "shards"

_JOB = "job.json"
_LOCK = ".lock"

#: What begins with this is not complete yet, or was left by a job that was killed.
_PARTIAL = ".partial-"

#: Number of characters of a value that are told where two jobs differ.
_TOLD = 60

#: The moments among the sums of a shard.
_MOMENTS = ("accuracy", "tracking", "seconds")


@contextmanager
def opened(
    directory: Path, jobs: Sequence[Job], resume: bool, extend: int = 0
) -> Iterator[Path]:
    """The folder of the shards of some jobs, of this process alone.

    What an earlier job has left is removed or, if asked, resumed: InputError if that was another
    job, or if another process computes in the folder. The runs are `extend` more than the earlier
    job had.
    """
    folder = directory / FOLDER
    folder.mkdir(exist_ok=True)
    try:
        with FileLock(folder / _LOCK, timeout=1):
            try:
                before = recorded(directory)
                _clear(folder, _PARTIAL)
                if before is None or not resume:
                    _clear(folder, "")
                else:
                    asked = record_of(jobs)
                    _refuse_other(directory, before, {**asked, "runs": asked["runs"] - extend})
                text = json.dumps(record_of(jobs), indent=2) + "\n"
                _write(folder / _JOB, text.encode())
                yield folder
            finally:
                _clear(folder, _PARTIAL)
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


def record_of(jobs: Sequence[Job]) -> Mapping[str, Any]:
    """What jobs are, in the words of JSON."""
    return {
        "runs": jobs[0].config.runs,
        "jobs": [
            {"options": dict(job.config.options), "depends on": description(job)} for job in jobs
        ],
    }


def jobs_of(record: Mapping[str, Any]) -> list[Job]:
    """The jobs of a record, in the package and with the libraries as they are now."""
    jobs = []
    for one in record["jobs"]:
        told = one["depends on"]
        config = Config(
            told["--scenario"],
            tuple(told["--identifiers"].split(",")),
            Options(**one["options"]),
            record["runs"],
            int(told["--seed"]),
        )
        jobs.append(Job.of(config, every_block=told["--keep"] == "all"))
    return jobs


def recorded(directory: Path) -> Mapping[str, Any] | None:
    """What was computed in the folder of some results, if anything."""
    try:
        found: Mapping[str, Any] = json.loads((directory / FOLDER / _JOB).read_text())
    except (FileNotFoundError, NotADirectoryError, ValueError):
        return None
    return found


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
    scenarios = ",".join(job["depends on"]["--scenario"] for job in record["jobs"])
    flat = {"--scenario": scenarios}
    for job in record["jobs"]:
        told = dict(job["depends on"])
        name = told.pop("--scenario")
        several = len(record["jobs"]) > 1
        flat |= {f"{key} of {name}" if several else key: value for key, value in told.items()}
    return {**flat, "--runs": record["runs"]}


def missing(folder: Path, jobs: Sequence[Job]) -> list[tuple[Job, int, Path]]:
    """The shards that are not there, or not whole, as units of work."""
    return [
        (job, number, folder)
        for job in jobs
        for number in range(shard_count(job))
        if read(folder, job, number) is None
    ]


def stored(job: Job, number: int, folder: Path) -> int:
    """Compute a shard and store it; the number of its runs."""
    found = shard(job, number)
    sums, rows = _paths(folder, job, number)
    sink = pa.BufferOutputStream()
    with _writer(sink, found.rows.schema) as writer:
        writer.write_table(found.rows)
    content = sink.getvalue().to_pybytes()
    _write(rows, content)
    stream = io.BytesIO()
    runs = shard_runs(job, number)
    digest = np.frombuffer(sha256(content).digest(), dtype=np.uint8)
    np.savez(stream, runs=runs, rows=digest, **_arrays(found.reduced))
    _write(sums, stream.getvalue())
    return runs


def read(folder: Path, job: Job, number: int) -> Reduced | None:
    """What a shard adds up to; None if it is not there, not whole or has other runs."""
    sums, rows = _paths(folder, job, number)
    try:
        with np.load(io.BytesIO(sums.read_bytes())) as stored:  # an archive with checksums
            arrays = {name: stored[name] for name in stored.files}
        digest = sha256(rows.read_bytes()).digest()
        if arrays["runs"] != shard_runs(job, number) or arrays["rows"].tobytes() != digest:
            return None
        return _reduced(arrays)
    except (OSError, BadZipFile, ValueError, KeyError, EOFError):
        return None


def write_rows(path: Path, folder: Path, jobs: Sequence[Job]) -> None:
    """The rows of all shards in one file, a row group a shard."""
    shards = [(job, number) for job in jobs for number in range(shard_count(job))]
    first = [pq.read_table(_paths(folder, job, 0)[1], read_dictionary=[*WORDS]) for job in jobs]
    schema = row_schema([rows.schema for rows in first])
    with _writer(path, schema) as writer:
        for job, number in shards:
            rows = pq.read_table(_paths(folder, job, number)[1], read_dictionary=[*WORDS])
            for field in schema:
                if field.name not in rows.column_names:
                    rows = rows.append_column(field, pa.nulls(len(rows), field.type))
            writer.write_table(rows.select(schema.names))


def _writer(where: Any, schema: pa.Schema) -> pq.ParquetWriter:
    """Numbers hardly repeat, words do: only these are worth a dictionary."""
    return pq.ParquetWriter(
        where, schema, compression="zstd", use_dictionary=[*WORDS], store_schema=False
    )


def _paths(folder: Path, job: Job, number: int) -> tuple[Path, Path]:
    name = f"{job.config.scenario}-{number:05}"
    return folder / f"{name}.npz", folder / f"{name}.parquet"


def _write(path: Path, content: bytes) -> None:
    """Write a file whole or not at all."""
    partly = path.with_name(f"{_PARTIAL}{path.name}")
    partly.write_bytes(content)
    os.replace(partly, path)


def _arrays(reduced: Reduced) -> dict[str, Any]:
    """The parts of what a shard adds up to, by name."""
    arrays: dict[str, Any] = {
        "delays": reduced.sums.delays,
        "places": reduced.places,
        "numbers": reduced.numbers,
        "compile_seconds": reduced.compile_seconds,
    }
    for name in _MOMENTS:
        moments: Moments = getattr(reduced.sums, name)
        arrays[f"{name} runs"] = moments.runs
        for key in moments.total:
            arrays[f"{name} total {key}"] = moments.total[key]
            arrays[f"{name} square {key}"] = moments.total_square[key]
    return arrays


def _reduced(arrays: Mapping[str, Any]) -> Reduced:
    moments = {}
    for name in _MOMENTS:
        parts = {
            kind: {
                key.removeprefix(f"{name} {kind} "): value
                for key, value in arrays.items()
                if key.startswith(f"{name} {kind} ")
            }
            for kind in ("total", "square")
        }
        moments[name] = Moments(int(arrays[f"{name} runs"]), parts["total"], parts["square"])
    return Reduced(
        Sums(**moments, delays=arrays["delays"]),
        arrays["places"],
        arrays["numbers"],
        arrays["compile_seconds"],
    )
