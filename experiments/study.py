"""A study as a job in shards: one set each, of which a row is left."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd
import pyarrow as pa

from adhesion_jax.campaign.identity import own_files, surroundings
from adhesion_jax.campaign.monte_carlo import frame_of
from adhesion_jax.campaign.pool import Processes
from adhesion_jax.campaign.store import Content, Tell, read, rows_of
from adhesion_jax.library.shards import compute, opened_for
from adhesion_jax.runtime import silent


class Study(NamedTuple):
    """The sets of a study, and what makes the row of one."""

    tasks: Sequence[Any]
    row: Callable[[Any], Mapping[str, object]]  # which other processes can import
    asked: Mapping[str, str]  # what tells the sets and what is studied, beside the source
    source: Sequence[Path]  # files that make the sets and judge what is found

    @property
    def name(self) -> str:
        return "study"

    @property
    def runs(self) -> int:
        return len(self.tasks)

    @property
    def shards(self) -> int:
        return len(self.tasks)

    def runs_of(self, shard: int) -> int:
        return 1

    @property
    def record(self) -> Mapping[str, Any]:
        source = b"".join(path.read_bytes() for path in self.source)
        source_of = {"source of the study": sha256(source).hexdigest()}
        return {"depends on": {**self.asked, **source_of, **surroundings(), **own_files()}}


@contextmanager
def studied(
    study: Study, directory: Path, names: Sequence[str], workers: int, resume: bool
) -> Iterator[tuple[pd.DataFrame, Path]]:
    """The rows of all sets, in their order, and a folder for the files of these names.

    The files are moved to the directory at the end. The rows of a study that is interrupted stay
    there, and one that is to resume it computes the others.
    """
    with opened_for("study", [study], directory, names, resume) as (folder, stage):
        compute(_content, [study], folder, lambda _: Processes(workers), "set")
        yield rows_in(folder, study), stage


def _content(study: Study, number: int, tell: Tell = silent) -> Content:
    """The row of a set, which is all that is stored of it."""
    tell(0, f"set {number + 1}")
    return Content({}, pa.Table.from_pylist([dict(study.row(study.tasks[number]))]))


def rows_in(folder: Path, study: Study) -> pd.DataFrame:
    """The rows of those sets that are there, in their order."""
    numbers = range(study.shards)
    there = [number for number in numbers if read(folder, study.name, number) is not None]
    rows = [frame_of(rows_of(folder, study.name, number)) for number in there]
    return pd.concat(rows, ignore_index=True)
