"""A study as a job in shards: one set each, of which a row is left; and what is counted of them."""

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np
import pandas as pd
import pyarrow as pa
from scipy.stats import binomtest

from adhesion_jax.campaign.identity import own_files, surroundings
from adhesion_jax.campaign.monte_carlo import frame_of
from adhesion_jax.campaign.pool import Processes
from adhesion_jax.campaign.store import Content, Tell, read, rows_of
from adhesion_jax.command_line.command import SEED, Folder
from adhesion_jax.errors import InputError
from adhesion_jax.files import output_directory, write_metadata, write_table
from adhesion_jax.library.shards import compute, opened_for
from adhesion_jax.runtime import silent
from experiments.command import described


class Study(NamedTuple):
    """The sets of a study, and what makes the row of one."""

    tasks: Sequence[Any]
    row: Callable[[Any], Mapping[str, object]]  # which other processes can import
    sizes: Mapping[str, int]  # the options that tell the sets
    asked: Mapping[str, str]  # what is studied, beside them and the source
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
        own = {option(name): str(size) for name, size in self.sizes.items()}
        own |= {**self.asked, "source of the study": sha256(source).hexdigest()}
        return {"depends on": {**own, **surroundings(), **own_files()}}


def option(name: str) -> str:
    return f"--{name.replace('_', '-')}"


def sized(sizes: Mapping[str, tuple[int, str]], out: Path) -> Callable[[Callable[..., None]], Any]:
    """A command with options of these names, defaults and helps that tell how many sets are made.

    And with the options that every study has.
    """
    count, workers = click.IntRange(min=0), click.IntRange(min=1)
    words = "Processes; the results do not depend on their number."
    again = "Compute what an interrupted study left over."
    options = [
        *(
            click.option(option(name), type=count, default=default, help=told)
            for name, (default, told) in sizes.items()
        ),
        click.option("--seed", type=SEED, default=0),
        click.option("--workers", type=workers, default=1, help=words),
        click.option("--resume", is_flag=True, help=again),
        click.option("--out", type=Folder(), default=out),
    ]

    def command(main: Callable[..., None]) -> Any:
        for one in reversed(options):
            main = one(main)
        return click.command(context_settings={"show_default": True})(main)

    return command


def conduct(
    study: Study,
    out: Path,
    names: Sequence[str],
    workers: int,
    resume: bool,
    report: Callable[[pd.DataFrame, Path], str],
) -> None:
    """Compute the rows of all sets, in their order, and write files of these names to a folder.

    sets.csv and metadata.json are among them; the others are written by `report`, which gives the
    words to print. The rows of a study that is interrupted stay in the folder, and one that is to
    resume it computes the others. InputError for a study of no sets.
    """
    if not study.tasks:
        raise InputError(
            f"A study of no sets says nothing; give {option(next(iter(study.sizes)))} above 0."
        )
    directory, began = output_directory(out), time.perf_counter()
    with opened_for("study", [study], directory, names, resume) as (folder, stage):
        compute(_content, [study], folder, lambda _: Processes(workers), "set")
        sets = rows_in(folder, study)
        write_table(stage / "sets.csv", sets)
        words = report(sets, stage)
        config = {**study.sizes, "workers": workers, "resumed": resume}
        write_metadata(stage / "metadata.json", described(config, began))
    click.echo(words)
    click.echo(f"\nWritten to {directory} in {time.perf_counter() - began:.0f} s")


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


# ------------------------------------------------------------------------------ what is counted

#: A group of sets, by its values of the labels, and the hits of each quantity among so many.
Group = tuple[tuple[object, ...], Mapping[str, tuple[int, int]]]


def rates_of(groups: Iterable[Group], labels: Sequence[str], method: str) -> pd.DataFrame:
    """A row for each group and quantity: count, hits, rate, low and high.

    The 95 % intervals are those of a method of scipy's binomtest; a rate of no sets is NaN.
    """
    rows = []
    for group, quantities in groups:
        for quantity, (hits, count) in quantities.items():
            share = (np.nan,) * 3
            if count:
                share = (hits / count, *binomtest(hits, count).proportion_ci(method=method))
            rows.append((*group, quantity, count, hits, *share))
    return pd.DataFrame(rows, columns=[*labels, "quantity", "count", "hits", "rate", "low", "high"])


def removed_share(before: float, after: float, noise: float) -> float:
    """(before^2 - after^2)/(before^2 - noise^2) of root mean square errors; NaN without excess."""
    excess = before**2 - noise**2
    # An excess below two per cent of the noise is chance, and so is the share of it.
    return (before**2 - after**2) / excess if excess > 0.02 * noise**2 else np.nan


def spread(shares: pd.Series) -> tuple[int, float, float, float]:
    """The number of the shares that are known, their median, lower quartile and lowest decile."""
    median, quartile, decile = shares.quantile([0.5, 0.25, 0.1])
    return int(shares.count()), median, quartile, decile
