"""`montecarlo`: how well methods know the truth of a scenario, one's own methods among them."""

import dataclasses
import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from os import PathLike
from pathlib import Path
from typing import Any, Literal

import jax
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from adhesion_jax import runtime
from adhesion_jax.campaign.cluster import pool_of
from adhesion_jax.campaign.job import ALL, SEVERAL, Config, Job, parts_of
from adhesion_jax.campaign.monte_carlo import (
    Campaign,
    Totals,
    added,
    campaign_of,
    run_campaign,
    suited,
)
from adhesion_jax.campaign.overview import OVERVIEW, overview
from adhesion_jax.campaign.shard import content
from adhesion_jax.campaign.store import read_all, write_rows
from adhesion_jax.errors import InputError
from adhesion_jax.files import METADATA, output_directory, write_metadata, write_table
from adhesion_jax.identifiers import IDENTIFIERS, Status
from adhesion_jax.identifiers.of_numpy import OfNumpy
from adhesion_jax.library.reading import Methods, methods_named
from adhesion_jax.library.results import recorded
from adhesion_jax.library.shards import check_numbers, compute, extended, opened_for
from adhesion_jax.options import check
from adhesion_jax.report.montecarlo import figures
from adhesion_jax.report.montecarlo.overview import figure as overview_figure
from adhesion_jax.report.montecarlo.overview import page as overview_page
from adhesion_jax.report.montecarlo.tables import accuracy_table, told
from adhesion_jax.report.rendering import write_page
from adhesion_jax.runtime import as_in_commands, silent
from adhesion_jax.scenarios import SCENARIOS, Options, declared
from adhesion_jax.wording import listed

#: The files of a campaign.
MONTECARLO_FILES = (
    *("summary.csv", "switches.csv", "checkpoints.csv", "runs.parquet", METADATA),
    *("steady.csv", "tracking.csv", "bands.csv"),
    *(f"{OVERVIEW}.csv", f"{OVERVIEW}.png", "report.html"),
    *("histogram_mu_max.png", "tracking.png", "convergence.png", "bands.png", "drift.png"),
)


@dataclass(frozen=True, eq=False, repr=False)
class MonteCarlo:
    """How well methods know the truth of a scenario, or of those of the main job, over all runs.

    Attributes:
        asked: what was asked for.
        keep: whose estimates there are: all, or checkpoints.
        jobs: the methods and the runs of each scenario.
        campaigns: the tables of each scenario.
        rows: the estimates, or the file where they are.
        seconds: by the clock.
    """

    asked: Config
    keep: str
    jobs: Sequence[Job]
    campaigns: Sequence[Campaign]
    rows: pd.DataFrame | Path
    seconds: float

    @cached_property
    def tables(self) -> Mapping[str, pd.DataFrame]:
        """By name: summary, and where a scenario has them switches, checkpoints, tracking, ...

        Of all scenarios there is an overview, too.
        """
        tables = _joined([campaign.tables for campaign in self.campaigns])
        if self.asked.scenario != ALL:
            return tables
        return {OVERVIEW: overview(self.jobs, self.campaigns), **tables}

    @property
    def summary(self) -> pd.DataFrame:
        """A row for each rail, identifier and quantity: truth, bias, RMSE, bound, coverage ..."""
        return self.tables["summary"]

    @property
    def estimates(self) -> pd.DataFrame:
        """A row for each run, identifier and block, or some of the blocks (`keep`)."""
        return pd.read_parquet(self.rows) if isinstance(self.rows, Path) else self.rows

    @property
    def remarks(self) -> str:
        """What is to be said of the methods: which are slow because Python computes them."""
        methods = {name: one for job in self.jobs for name, one in job.methods.items()}
        slow = [name for name, method in methods.items() if isinstance(method, OfNumpy)]
        return f"\nSlow, because it is called in Python: {listed(slow)}" if slow else ""

    def write(self, folder: str | PathLike[str]) -> None:
        """The files MONTECARLO_FILES that apply, as the command writes them."""
        path = output_directory(Path(folder))
        if not (path / "runs.parquet").exists():
            self.estimates.to_parquet(path / "runs.parquet", index=False)
        for name, table in self.tables.items():
            write_table(path / f"{name}.csv", table)
        for name, figure in self._figures():
            figure.savefig(path / f"{name}.png")
        if OVERVIEW in self.tables:
            write_page(path, overview_page(self.tables[OVERVIEW], self.asked.runs))
        names = [job.config.scenario for job in self.jobs]
        of_campaigns = zip(names, self.campaigns, strict=True)
        metadata = {
            "config": {
                **vars(self.asked),
                "options": dict(self.asked.options),
                "scenario": ",".join(names),
                "keep": self.keep,
            },
            "in_force": {job.config.scenario: _in_force(job) for job in self.jobs},
            "identifiers": {job.config.scenario: job.names for job in self.jobs},
            "seed": self.asked.seed,
            "statuses": {status.name.lower(): status.sentence for status in Status},
            "compile_seconds": {name: found.compile_seconds for name, found in of_campaigns},
            "wall_seconds": self.seconds,
            **runtime.describe(),
        }
        write_metadata(path / METADATA, metadata)

    @as_in_commands
    def plot(self) -> Figure:
        """The density of mu_max by each method; without mu_max, the estimates over the run."""
        return next(iter(self._figures()))[1]

    def _figures(self) -> Iterator[tuple[str, Figure]]:
        """The figures with their names, each drawn when it is asked for."""
        if OVERVIEW in self.tables:
            yield OVERVIEW, overview_figure(self.tables[OVERVIEW])
            return
        densities = [found.histogram for found in self.campaigns if len(found.histogram)]
        if densities:
            several = pd.concat(densities, ignore_index=True)
            yield "histogram_mu_max", figures.histogram(self.summary, several)
        for job, campaign in zip(self.jobs, self.campaigns, strict=True):
            scenario = job.scenario
            truth = pd.DataFrame(scenario.quantities())
            truth.insert(0, "block", np.arange(len(truth)))
            for name, reached in scenario.figures():
                if name == "bands":
                    steps = jax.eval_shape(scenario.draw, jax.random.key(0)).slip.shape[-1]
                    yield name, figures.bands(truth, campaign.bands, steps)
                elif name == "tracking":
                    yield name, figures.tracking(truth, campaign.bands)
                elif name == "drift":
                    yield name, figures.drift(campaign.tables["checkpoints"])
                elif reached is not None:
                    course = self.tables["checkpoints"], campaign.bands
                    yield name, figures.convergence(*course, *reached)

    def __repr__(self) -> str:
        there = tuple(dict.fromkeys(self.summary["quantity"]))
        told = ("mu_max",) if "mu_max" in there else there
        return accuracy_table(self.summary, told) + self.remarks

    def _repr_html_(self) -> str:
        return self.summary.to_html(index=False)


@recorded
@as_in_commands
def montecarlo(
    scenario: str | None = "single",
    identifiers: Methods | None = None,
    runs: int = 256,
    seed: int = 0,
    workers: int = 1,
    out: str | PathLike[str] | None = None,
    keep: Literal["checkpoints", "all"] = "checkpoints",
    resume: bool = False,
    extend: int = 0,
    cluster: str | None = None,
    **options: object,
) -> MonteCarlo:
    """Identify the same noisy runs of a scenario by several methods.

    With a folder memory does not grow with the number of runs.

    Args:
        scenario: a name of SCENARIOS, None for those of the main job of the command, or all for
            every one, with a page on which method to take when.
        identifiers: names of IDENTIFIERS, or methods of your own by name, functions of the slips
            and adhesions of a block among them; by default all that accept the scenario.
        runs: their number; run r of a seed has the same noise whatever else is asked for.
        seed: of the noise.
        workers: processes, which a script must start under `if __name__ == "__main__":`.
        out: a folder for the files of the command; what is finished stays there in shards.
        keep: whose estimates are kept in a folder: all, or those of the blocks around a switch and
            of the last.
        resume: go on with a job that was interrupted.
        extend: further runs for the job in the folder.
        cluster: local:N, or the address of a scheduler of Dask, whose workers compute.
        **options: arguments of the scenario, such as rail, sigma, points.

    Returns:
        Tables of the accuracy, and the estimates.

    Raises:
        InputError: a name, a number or an option does not fit.
    """
    began = time.perf_counter()
    given = {name: value for name, value in options.items() if value is not None}
    whole = Options(**given) if scenario in SEVERAL else _options(str(scenario), given)
    if keep not in ("checkpoints", "all"):
        raise InputError(f"keep is checkpoints or all, not {keep!r}.")
    if out is None and cluster:
        raise InputError("a cluster is for a job in a folder; name it as out.")
    check_numbers(runs, workers, seed)
    named = {} if identifiers is None else methods_named(identifiers)
    methods = {**IDENTIFIERS, **named}
    runs = extended(out, runs, resume, extend)
    asked = Config(scenario or "", tuple(named), whole, int(runs), int(seed))
    several = SEVERAL.get(scenario)
    parts = parts_of(asked, several, methods) if several else [asked]
    jobs = [Job.of(config, methods, every_block=out is None or keep == "all") for config in parts]
    if out is None:
        estimates: list[pd.DataFrame] = []
        found = [run_campaign(one, estimates.append, silent, workers, methods) for one in parts]
        rows = pd.concat(estimates, ignore_index=True)
        return MonteCarlo(asked, "all", jobs, found, rows, time.perf_counter() - began)
    directory = output_directory(Path(out))
    with (
        pool_of(workers, cluster) as pool,
        opened_for("montecarlo", jobs, directory, MONTECARLO_FILES, resume, extend) as (
            folder,
            stage,
        ),
    ):
        compute(content, jobs, folder, partial(suited, pool))
        found = [campaign_of(job, _totals(job, folder)) for job in jobs]
        write_rows(stage / "runs.parquet", folder, jobs)
        seconds = time.perf_counter() - began
        MonteCarlo(asked, keep, jobs, found, stage / "runs.parquet", seconds).write(stage)
    seconds = time.perf_counter() - began
    return MonteCarlo(asked, keep, jobs, found, directory / "runs.parquet", seconds)


def _totals(job: Job, folder: Path) -> Totals:
    """What those shards of a job add up to that are there."""
    return added(job, read_all(folder, job.name, job.shards))


def stored_tables(record: Mapping[str, Any], folder: Path) -> str:
    """The tables, for a terminal, of those shards that are there of the job of a record."""
    job = Job.recorded(record)
    totals = _totals(job, folder)
    return told(campaign_of(job, totals).tables, totals.accuracy.runs, [job.name])


def _options(scenario: str, options: Mapping[str, object]) -> Options:
    """The arguments of a scenario; InputError where it takes none such, or lacks one."""
    if scenario not in SCENARIOS:
        raise InputError(
            f"There is no scenario {scenario}; the scenarios are {', '.join(SCENARIOS)}."
        )
    known = declared(SCENARIOS[scenario])
    check(scenario, known, Options(**options))
    return Options(**{name: _option(name, known[name], value) for name, value in options.items()})


def _option(name: str, one: Any, value: object) -> object:
    """The value of an option as a scenario takes it; InputError where it lies outside its range."""
    if one.kind is str:
        return str(value)
    try:
        number = one.kind(value)
        right = number == value and math.isfinite(number) and one.option.holds(float(number))
    except (TypeError, ValueError, OverflowError):
        right = False
    if not right:
        kind = "a whole number" if one.kind is int else "a number"
        raise InputError(f"{name} is {kind} {one.option.range()}, not {value!r}.")
    return number


def _in_force(job: Job) -> dict[str, object]:
    """What the options and the scenario's own defaults come to; the slip is that of one tile."""
    slip = np.asarray(job.tiles.draw(0, 0).slip)
    return {
        "rails": job.scenario.rails,
        **dataclasses.asdict(job.scenario.noise),
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
