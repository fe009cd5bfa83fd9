"""A Monte Carlo campaign: every identifier on the same runs, and tables of what they add up to."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np
import pandas as pd
import pyarrow as pa
from numpy.typing import NDArray

from adhesion_jax.campaign.job import Config, Job
from adhesion_jax.campaign.pool import Pool, Processes, Work
from adhesion_jax.campaign.shard import content, scales, truth_of
from adhesion_jax.campaign.store import Arrays
from adhesion_jax.campaign.tiles import TILE
from adhesion_jax.identifiers import IDENTIFIERS, Identifier
from adhesion_jax.metrics.accuracy import table_rows
from adhesion_jax.metrics.counts import BINS, edges, middles, quantile, rebinned, share_middles
from adhesion_jax.metrics.moments import Moments
from adhesion_jax.metrics.tracking import criteria_of, tracking_row
from adhesion_jax.runtime import CORES

P = TypeVar("P", bound=Pool)

#: Largest number of shards that are computed in this process alone: others would take longer to
#: start than the work does.
_FEW_SHARDS = 2

#: The histogram reaches this multiple of the bound to either side of the truth.
_WIDTHS = 6

#: Number of bins of the histogram.
_HISTOGRAM_BINS = 60


#: The moments among the arrays of a shard.
_MOMENTS = ("accuracy", "tracking", "seconds")


class Totals(NamedTuple):
    """What the arrays of shards add up to; counts are [names, blocks, counted quantities, BINS]."""

    accuracy: Moments
    tracking: Moments
    seconds: Moments
    delays: NDArray[np.int64]
    counts: NDArray[np.int32]
    compile_seconds: NDArray[np.float64]


class Campaign(NamedTuple):
    """The tables by name (summary, switches, checkpoints, tracking, bands), and what is drawn.

    `bands` has the median and the band from 5 to 95 % of each quantity after each block, over all
    runs; `histogram` the probability density of mu_max in bins about the truth.
    """

    tables: Mapping[str, pd.DataFrame]
    bands: pd.DataFrame
    histogram: pd.DataFrame
    compile_seconds: Mapping[str, float]


def run_campaign(
    config: Config,
    keep: Callable[[pd.DataFrame], None],
    progress: Callable[[str], None],
    workers: int = CORES,
    identifiers: Mapping[str, Identifier] = IDENTIFIERS,
) -> Campaign:
    """Runs all identifiers on all runs, in memory.

    `keep` is called with the estimates of each shard, one row per estimate, in the order of the
    runs; `progress` with the name of the scenario for each tile of runs that is done. The names in
    the configuration are looked up in `identifiers`.
    """
    job = Job.of(config, identifiers)
    work = [(job, number) for number in range(job.shards)]

    def parts() -> Iterable[Arrays]:
        for (_, number), found in zip(work, results, strict=True):
            keep(frame_of(found.rows))
            for tile in job.tiles_of(number):
                if tile * TILE < config.runs:
                    progress(config.scenario)
            yield found.arrays

    with suited(Processes(workers), work).mapped(content, work) as results:
        return campaign_of(job, added(job, parts()))


def frame_of(rows: pa.Table) -> pd.DataFrame:
    """The rows as a data frame."""
    types = [pa.string() if pa.types.is_dictionary(f.type) else f.type for f in rows.schema]
    return rows.cast(pa.schema(zip(rows.schema.names, types, strict=True))).to_pandas()


def suited(pool: P, work: Work) -> P | Processes:
    """The pool for units that begin with a job: for few it is this process, made ready for them.

    A cluster is what it is: it has begun already.
    """
    if not isinstance(pool, Processes) or (pool.workers > 1 and len(work) > _FEW_SHARDS):
        return pool
    for job, *_ in work:
        job.tiles.make_ready(job.methods.values())
    return Processes(1)


def added(job: Job, parts: Iterable[Arrays]) -> Totals:
    """What the shards of a job add up to, in the order in which they are given."""
    names, blocks = len(job.names), len(job.scenario.rails)
    counts = np.zeros((names, blocks, len(job.counted), BINS), dtype=np.int32)
    flat, seconds = counts.reshape(-1), np.zeros(len(job.methods))
    sums: dict[str, NDArray[Any]] = {}
    for part in parts:
        flat[part["places"]] += part["numbers"]
        seconds = np.maximum(seconds, part["compile_seconds"])
        adding = (key for key in part if key.startswith((*_MOMENTS, "delays")))
        sums = {key: np.asarray(sums.get(key, 0) + part[key]) for key in adding}
    if not sums:
        raise ValueError("a campaign has one run or more")
    accuracy, tracking, times = (Moments.of_arrays(sums, name) for name in _MOMENTS)
    return Totals(accuracy, tracking, times, sums["delays"], counts, seconds)


def campaign_of(job: Job, totals: Totals) -> Campaign:
    """The tables of a job, and what is drawn of it, from what its shards add up to."""
    scenario = job.scenario
    accuracy = _accuracy_tables(job, totals)
    tables = dict(accuracy)
    # Blocks on one rail have nothing to follow, and no course has a method that asks for the slope.
    of_stream = scenario.known.by_sample and "mu_max" in scenario.quantities()
    if len(job.stretches) > 1 or of_stream:
        tables["tracking"] = _tracking_table(job, totals)
    bands = _bands(job, totals)
    if scenario.known.by_sample:
        tables["bands"] = bands
    seconds = dict(zip(job.methods, totals.compile_seconds.tolist(), strict=True))
    return Campaign(
        tables,
        bands,
        _histogram(job, totals, accuracy["summary"]),
        {name: seconds[name] for name in job.names},
    )


def _accuracy_tables(job: Job, totals: Totals) -> dict[str, pd.DataFrame]:
    scenario = job.scenario
    none = np.full((1, len(scenario.rails), len(scenario.quantities())), np.nan)
    truth = truth_of(scenario, none)
    methods = [*job.methods]
    parts: dict[str, list[dict[str, Any]]] = {name: [] for name in scenario.tables()}
    for place, row in enumerate(job.rows):
        names = {
            "scenario": job.config.scenario,
            "identifier": row.identifier,
            "rail": row.group.rail,
            **({} if row.group.k is None else {"k": row.group.k}),
        }
        seconds = totals.seconds.at(methods.index(row.identifier))
        moments = totals.accuracy.at(place)
        parts[row.table].append({**names, **table_rows(moments, truth, row.group.blocks, seconds)})
    return {name: _one_below_the_other(of_table) for name, of_table in parts.items()}


def _one_below_the_other(parts: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    """Parts of a table, each of which has a row for each quantity, or one value for all of them."""
    return pd.DataFrame(
        {
            name: np.concatenate([np.broadcast_to(p[name], len(p["quantity"])) for p in parts])
            for name in parts[0]
        }
    )


def _tracking_table(job: Job, totals: Totals) -> pd.DataFrame:
    """A row for each identifier and stretch of rail."""
    unit = criteria_of(job.scenario.known).unit
    rows = []
    for place, name in enumerate(job.names):
        for stretch, rail in enumerate(job.stretches):
            moments = totals.tracking.at((place, stretch))
            row = tracking_row(totals.delays[place, stretch], moments, stretch == 0, unit)
            names = {"scenario": job.config.scenario, "identifier": name, "rail": rail}
            rows.append({**names, **row})
    return pd.DataFrame(rows)


def _bands(job: Job, totals: Totals) -> pd.DataFrame:
    centre, scale = scales(job.tiles)
    counted, frames = job.counted, []
    for place, name in enumerate(job.names):
        for number, quantity in enumerate(counted):
            counts = totals.counts[place, :, number]
            if number < centre.shape[1]:
                middle = middles(centre[:, number], scale[:, number])
            else:
                middle = np.broadcast_to(share_middles(), counts.shape)
            low, median, high = (quantile(counts, middle, share) for share in (0.05, 0.5, 0.95))
            columns = {
                "scenario": job.config.scenario,
                "identifier": name,
                "quantity": quantity,
                "block": np.arange(len(middle)),
                "p05": low,
                "median": median,
                "p95": high,
            }
            frames.append(pd.DataFrame(columns))
    return pd.concat(frames, ignore_index=True)


def _histogram(job: Job, totals: Totals, summary: pd.DataFrame) -> pd.DataFrame:
    """The density of mu_max over all blocks of a rail that stand in the summary.

    One row a bin; where the scenario has no mu_max there is none. Half the width is a multiple of
    the bound or, without one, of the spread.
    """
    if "mu_max" not in job.counted:
        return pd.DataFrame()
    number = job.counted.index("mu_max")
    centre, scale = (x[:, number] for x in scales(job.tiles))
    peaks = summary[summary["quantity"] == "mu_max"].set_index(["rail", "identifier"])
    groups = job.scenario.tables()["summary"]
    frames = []
    for rail in dict.fromkeys(group.rail for group in groups):
        blocks = [b for group in groups if group.rail == rail for b in group.blocks]
        for place, name in enumerate(job.names):
            row = peaks.loc[[(rail, name)]].iloc[0]
            first = peaks.loc[[(rail, job.names[0])]].iloc[0]
            spread = np.sqrt(max(row["rmse"] ** 2 - row["bias"] ** 2, 0.0))
            width = first["crlb"] if np.isfinite(first["crlb"]) else spread
            reach = _WIDTHS * max(width, 1e-9)
            lines = first["truth"] + np.linspace(-reach, reach, _HISTOGRAM_BINS + 1)
            counts = [totals.counts[place, b, number] for b in blocks]
            found = sum(
                rebinned(count, edges(centre[b], scale[b]), lines)
                for b, count in zip(blocks, counts, strict=True)
            )
            columns = {
                "scenario": job.config.scenario,
                "rail": rail,
                "identifier": name,
                "lower": lines[:-1],
                "upper": lines[1:],
                "density": found / (max(np.sum(counts), 1) * np.diff(lines)),
            }
            frames.append(pd.DataFrame(columns))
    return pd.concat(frames, ignore_index=True)
