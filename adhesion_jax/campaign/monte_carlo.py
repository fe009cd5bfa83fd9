"""A Monte Carlo campaign: every identifier on the same runs, tile by tile, on all cores."""

import multiprocessing
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from tempfile import TemporaryDirectory
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd

from adhesion_jax.campaign.config import Config, build_scenario, choose_identifiers
from adhesion_jax.campaign.tiles import (
    TILE,
    TileResult,
    bound_tile,
    draw_tile,
    identify_tile,
    tile_runs,
)
from adhesion_jax.identifiers import IDENTIFIERS, Estimate, Status
from adhesion_jax.metrics.accuracy import Outcome, Truth, run_statistics, table_rows
from adhesion_jax.metrics.information import quantities, quantity_names
from adhesion_jax.metrics.moments import Moments
from adhesion_jax.optim.box import on_bound
from adhesion_jax.runtime import CORES, share_compilations
from adhesion_jax.scenarios import Group, Record, Scenario

#: The method whose objective every other is held against.
REFERENCE = "ml-exact"

#: Statuses that count as a failure whatever the method.
_UNUSABLE = (Status.NO_PEAK, Status.INADMISSIBLE, Status.NOT_FINITE)


class Campaign(NamedTuple):
    """The tables by name (summary, switches, checkpoints) and the seconds of compilation."""

    tables: Mapping[str, pd.DataFrame]
    compile_seconds: Mapping[str, float]


class _Row(NamedTuple):
    """Which row of which table some statistics belong to."""

    table: str
    group: Group
    identifier: str


def progress_steps(config: Config) -> int:
    """How often `run_campaign` reports progress."""
    scenario = build_scenario(config)
    return len(_methods(scenario, choose_identifiers(config, scenario))) * _tiles(config)


def run_campaign(
    config: Config,
    keep: Callable[[pd.DataFrame], None],
    progress: Callable[[str], None],
    workers: int = CORES,
) -> Campaign:
    """Run all identifiers on all runs; what is kept of a run is its share in some sums.

    `keep` is given the estimates of each tile of runs, one row an estimate, in the order of the
    runs; `progress` the name of the identifier whenever one is done with a tile.
    """
    scenario = build_scenario(config)
    names = choose_identifiers(config, scenario)
    methods = _methods(scenario, names)
    rows = [
        _Row(table, group, name)
        for table, groups in scenario.tables().items()
        for name in names
        for group in groups
    ]
    tally: dict[int, Moments] = {}
    seconds: dict[str, list[float]] = {name: [] for name in methods}
    compile_seconds = dict.fromkeys(methods, 0.0)
    work = [(config, tile, name) for tile in range(_tiles(config)) for name in methods]
    with _mapped(identify_tile, work, workers) as results:
        for tile in range(_tiles(config)):
            runs = tile_runs(tile)
            runs = runs[runs < config.runs]
            estimates: dict[str, Estimate] = {}
            for name in methods:
                result: TileResult = next(results)
                seconds[name].append(result.seconds / (TILE * len(scenario.rails)))
                compile_seconds[name] = max(compile_seconds[name], result.compile_seconds)
                estimates[name] = jax.tree.map(lambda x: x[: len(runs)], result.estimate)  # noqa: B023
                progress(name)
            records = draw_tile(config, tile)
            truth = _truth(scenario, records, np.asarray(bound_tile(config, records))[: len(runs)])
            _count(tally, rows, scenario, estimates, truth)
            keep(_estimate_rows(scenario, names, estimates, runs))

    tables = {
        table: pd.concat(
            [
                _table_rows(config, row, tally[index], truth, np.array(seconds[row.identifier]))
                for index, row in enumerate(rows)
                if row.table == table
            ],
            ignore_index=True,
        )
        for table in scenario.tables()
    }
    return Campaign(tables, {name: compile_seconds[name] for name in names})


def _tiles(config: Config) -> int:
    return -(-config.runs // TILE)


def _methods(scenario: Scenario, names: tuple[str, ...]) -> tuple[str, ...]:
    """What is run: the reference wherever it can be, even where it is not reported.

    One method of each compiled form first, so that the workers begin by compiling different ones.
    """
    has_reference = IDENTIFIERS[REFERENCE].accepts(scenario) is None
    methods = dict.fromkeys((*([REFERENCE] if has_reference else []), *names))
    first_of_form = {jax.tree.structure(IDENTIFIERS[name]): name for name in reversed(methods)}
    firsts = [name for name in methods if name in first_of_form.values()]
    return (*firsts, *(name for name in methods if name not in firsts))


@contextmanager
def _mapped(
    function: Callable[..., TileResult], work: list[tuple[Config, int, str]], workers: int
) -> Iterator[Iterator[TileResult]]:
    """The results in the order of the work, from as many processes as there is work for.

    Processes, because two threads that run compiled loops in one process can wait for each
    other for ever, and spawned, because a fork of a process in which jax runs is not safe.
    """
    tiles = len({tile for _, tile, _ in work})
    if min(workers, tiles) == 1:
        yield (function(*unit) for unit in work)
        return
    with (
        TemporaryDirectory() as folder,
        ProcessPoolExecutor(
            min(workers, tiles),
            mp_context=multiprocessing.get_context("spawn"),
            initializer=share_compilations,
            initargs=(folder,),
        ) as pool,
    ):
        try:
            yield pool.map(function, *zip(*work, strict=True))
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _truth(scenario: Scenario, records: Record, bound: np.ndarray) -> Truth:
    # [blocks, points], or with the runs in front where the mask differs between them.
    points = np.asarray(records.mask).reshape(-1, *records.mask.shape[-2:])[0].sum(axis=-1)
    return Truth(
        names=quantity_names(scenario.known.curve),
        values=np.stack([np.asarray(quantities(curve)) for curve in scenario.truth]),
        bound=bound,
        sigma=scenario.sigma,
        degrees_of_freedom=points - len(scenario.known.curve.free),
    )


def _count(
    tally: dict[int, Moments],
    rows: list[_Row],
    scenario: Scenario,
    estimates: Mapping[str, Estimate],
    truth: Truth,
) -> None:
    """Add the runs of a tile to the sums behind every row of every table."""
    # Where the exact optimum is not known no gap to it counts as a failure.
    outcomes = {
        name: _outcome(scenario, e, estimates.get(REFERENCE, e)) for name, e in estimates.items()
    }
    for index, row in enumerate(rows):
        outcome = outcomes[row.identifier]
        part = Moments.of(run_statistics(outcome, truth, row.group.blocks, row.group.after_switch))
        tally[index] = tally[index].plus(part) if index in tally else part


def _standard_errors(estimate: Estimate) -> np.ndarray:
    return np.sqrt(np.diagonal(estimate.covariance, axis1=-2, axis2=-1))


def _values(estimate: Estimate) -> np.ndarray:
    return np.stack(list(estimate.values.values()), axis=-1)


def _on_box(scenario: Scenario, estimate: Estimate) -> np.ndarray:
    known = scenario.known
    parameters = _values(estimate)[..., : len(known.curve.free)]
    return np.asarray(jnp.any(on_bound(parameters, known.lower, known.upper), axis=-1))


def _outcome(scenario: Scenario, estimate: Estimate, optimum: Estimate) -> Outcome:
    return Outcome(
        values=_values(estimate),
        standard_errors=_standard_errors(estimate),
        on_box=_on_box(scenario, estimate),
        unusable=np.isin(estimate.status, _UNUSABLE),
        objective=np.asarray(estimate.objective),
        optimum=np.asarray(optimum.objective),
        optimum_on_box=_on_box(scenario, optimum),
        evaluations=np.asarray(estimate.evaluations),
    )


def _table_rows(
    config: Config, row: _Row, moments: Moments, truth: Truth, seconds: np.ndarray
) -> pd.DataFrame:
    table = table_rows(moments, truth, row.group.blocks, seconds)
    names: dict[str, str | int] = {
        "scenario": config.scenario,
        "identifier": row.identifier,
        "rail": row.group.rail,
    }
    if row.group.k is not None:
        names["k"] = row.group.k
    for place, (column, value) in enumerate(names.items()):
        table.insert(place, column, value)
    return table


def _estimate_rows(
    scenario: Scenario,
    names: tuple[str, ...],
    estimates: Mapping[str, Estimate],
    runs: np.ndarray,
) -> pd.DataFrame:
    """One row a run, identifier and block."""
    blocks = np.arange(len(scenario.rails))
    frames = []
    for name in names:
        estimate, errors = estimates[name], _standard_errors(estimates[name])
        columns: dict[str, object] = {
            "run": np.repeat(runs, len(blocks)),
            "identifier": name,
            "block": np.tile(blocks, len(runs)),
            "rail": np.tile(np.array(scenario.rails), len(runs)),
        }
        columns |= {key: np.ravel(value) for key, value in estimate.values.items()}
        columns |= {f"{key}_se": errors[..., i].ravel() for i, key in enumerate(estimate.values)}
        columns |= {
            "status": [Status(code).name.lower() for code in np.ravel(estimate.status)],
            "objective": np.ravel(estimate.objective),
            "evaluations": np.ravel(estimate.evaluations),
        }
        frames.append(pd.DataFrame(columns))
    return pd.concat(frames, ignore_index=True)
