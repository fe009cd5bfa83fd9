"""A Monte Carlo campaign: every identifier on the same runs, tile by tile, on all cores."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
from jaxtyping import Array, ArrayLike, Bool, Float
from scipy.special import stdtrit

from adhesion_jax.campaign.config import Config, build_scenario, choose_identifiers
from adhesion_jax.campaign.executor import mapped
from adhesion_jax.campaign.rows import (
    bands_table,
    estimate_rows,
    standard_errors,
    tracking_table,
    values_of,
)
from adhesion_jax.campaign.tiles import (
    TILE,
    TileResult,
    bound_tile,
    draw_tile,
    identify_tile,
    make_ready,
    tile_runs,
)
from adhesion_jax.identifiers import IDENTIFIERS, Estimate, Identifier, Status
from adhesion_jax.metrics.accuracy import Outcome, Truth, run_statistics, table_rows
from adhesion_jax.metrics.moments import Moments
from adhesion_jax.metrics.tracking import Tracking
from adhesion_jax.optim.box import on_bound
from adhesion_jax.programs import kept
from adhesion_jax.records import Record
from adhesion_jax.runtime import CORES
from adhesion_jax.scenarios import Group, Scenario

#: The method with whose objective every other is compared.
REFERENCE = "ml-exact"

#: Number of tiles whose runs give the bands of a stream, so that memory does not grow with runs.
_BAND_TILES = 2

#: Largest number of tiles of a campaign that is run in this process alone.
_FEW_TILES = 2

#: Statuses that count as a failure for every method.
_UNUSABLE = (Status.NO_PEAK, Status.INADMISSIBLE, Status.NOT_FINITE)


class Campaign(NamedTuple):
    """The tables by name (summary, switches, checkpoints, tracking, bands).

    And the seconds of compilation of each identifier.
    """

    tables: Mapping[str, pd.DataFrame]
    compile_seconds: Mapping[str, float]


class _Row(NamedTuple):
    """The table and the row to which some statistics belong."""

    table: str
    group: Group
    identifier: str


def progress_steps(config: Config, identifiers: Mapping[str, Identifier] = IDENTIFIERS) -> int:
    """The number of times that progress is reported for one configuration."""
    return len(_work(config, identifiers))


def run_campaigns(
    configs: Sequence[Config],
    keep: Callable[[pd.DataFrame], None],
    progress: Callable[[str], None],
    workers: int = CORES,
    identifiers: Mapping[str, Identifier] = IDENTIFIERS,
) -> list[Campaign]:
    """Runs all identifiers on all runs; runs are reduced to sums tile by tile.

    `keep` is called with the estimates of each tile, one row per estimate, in the order of the
    runs; `progress` with the name of an identifier whenever it has finished a tile. The names in
    the configurations are looked up in `identifiers`.
    """
    work = [unit for config in configs for unit in _work(config, identifiers)]
    tiles = len({tile for _, tile, _, _ in work})
    if tiles <= _FEW_TILES:  # processes would take longer to start than the work does
        workers = 1
        first = [unit for unit in work if unit[1] == 0]
        for config in configs:
            make_ready(config, [method for whose, _, _, method in first if whose == config])
    with mapped(identify_tile, work, min(workers, tiles)) as results:
        return [_gathered(config, results, keep, progress, identifiers) for config in configs]


def run_campaign(
    config: Config,
    keep: Callable[[pd.DataFrame], None],
    progress: Callable[[str], None],
    workers: int = CORES,
    identifiers: Mapping[str, Identifier] = IDENTIFIERS,
) -> Campaign:
    """`run_campaigns` of a single configuration."""
    return run_campaigns([config], keep, progress, workers, identifiers)[0]


def _work(
    config: Config, identifiers: Mapping[str, Identifier]
) -> list[tuple[Config, int, str, Identifier]]:
    """The units of work in the order in which their results are taken."""
    scenario = build_scenario(config)
    methods = _methods(scenario, choose_identifiers(config, scenario, identifiers), identifiers)
    return [
        (config, tile, name, identifiers[name])
        for tile in range(_tiles(config))
        for name in methods
    ]


def _gathered(
    config: Config,
    results: Iterator[TileResult],
    keep: Callable[[pd.DataFrame], None],
    progress: Callable[[str], None],
    identifiers: Mapping[str, Identifier],
) -> Campaign:
    """The tables of one configuration, from its results."""
    scenario = build_scenario(config)
    names = choose_identifiers(config, scenario, identifiers)
    methods = _methods(scenario, names, identifiers)
    rows = [
        _Row(table, group, name)
        for table, groups in scenario.tables().items()
        for name in names
        for group in groups
    ]
    tally: dict[int, Moments] = {}
    # Medians need every run. Without a change of the rail there is no delay to report.
    switches = any(a != b for a, b in pairwise(scenario.rails))
    seen: dict[str, list[Tracking]] = {name: [] for name in names}
    first_tiles: list[dict[str, Estimate]] = []
    seconds: dict[str, list[float]] = {name: [] for name in methods}
    compile_seconds = dict.fromkeys(methods, 0.0)
    for tile in range(_tiles(config)):
        runs = tile_runs(tile)
        runs = runs[runs < config.runs]
        estimates: dict[str, Estimate] = {}
        tracking: dict[str, Tracking] = {}
        for name in methods:
            result: TileResult = next(results)
            seconds[name].append(result.seconds / (TILE * len(scenario.rails)))
            compile_seconds[name] = max(compile_seconds[name], result.compile_seconds)
            estimates[name], tracking[name] = jax.tree.map(
                lambda x: x[: len(runs)],  # noqa: B023
                (result.estimate, result.tracking),
            )
            progress(name)
        records = draw_tile(config, tile)
        truth = _truth(scenario, np.asarray(bound_tile(config, records))[: len(runs)])
        pool = _pooled(scenario, records, truth)
        truths = {name: pool if identifiers[name].POOLS else truth for name in methods}
        # A gap to the exact optimum is a failure only if the optimum is known and minimised.
        optima = {
            name: estimates.get(REFERENCE, e) if identifiers[name].FITS_LAST_RECORD else e
            for name, e in estimates.items()
        }
        _count(tally, rows, scenario, estimates, optima, tracking, truths)
        keep(estimate_rows(config, scenario, names, estimates, runs))
        if switches:
            for name in names:
                seen[name].append(tracking[name])
        if scenario.known.by_sample and tile < _BAND_TILES:
            first_tiles.append({name: estimates[name] for name in names})

    tables = {
        table: pd.concat(
            [
                _table_rows(
                    config,
                    row,
                    tally[index],
                    truths[row.identifier],
                    np.array(seconds[row.identifier]),
                )
                for index, row in enumerate(rows)
                if row.table == table
            ],
            ignore_index=True,
        )
        for table in scenario.tables()
    }
    if switches:
        tables["tracking"] = tracking_table(config, scenario, seen)
    if first_tiles:
        tables["bands"] = bands_table(config, scenario, first_tiles)
    return Campaign(tables, {name: compile_seconds[name] for name in names})


def _tiles(config: Config) -> int:
    return -(-config.runs // TILE)


def _methods(
    scenario: Scenario, names: tuple[str, ...], identifiers: Mapping[str, Identifier]
) -> tuple[str, ...]:
    """The methods to run; the reference is among them if it accepts the scenario, reported or not.

    One method of each compiled form comes first, so that the workers compile different ones.
    """
    reference = identifiers.get(REFERENCE)
    has_reference = reference is not None and reference.accepts(scenario.known) is None
    methods = dict.fromkeys((*([REFERENCE] if has_reference else []), *names))
    first_of_form = {jax.tree.structure(identifiers[name]): name for name in reversed(methods)}
    firsts = [name for name in methods if name in first_of_form.values()]
    return (*firsts, *(name for name in methods if name not in firsts))


def _truth(scenario: Scenario, bound: np.ndarray) -> Truth:
    quantities = scenario.quantities()
    degrees_of_freedom = np.maximum(scenario.support() - len(scenario.known.curve.free), 1)
    return Truth(
        names=tuple(quantities),
        values=np.stack(list(quantities.values()), axis=-1),
        bound=bound,
        sigma=scenario.sigma,
        quantile=stdtrit(degrees_of_freedom, 0.975),
    )


def _pooled(scenario: Scenario, records: Record, truth: Truth) -> Truth:
    """The truth for a method that pools the blocks since the rail last changed.

    The blocks of a rail have equal information, so that the bound of a pool of k is smaller by the
    root of k. A block that contains the points of those before it is such a pool already.
    """
    fresh = np.asarray(records.fresh).sum(axis=-1)
    points = np.zeros(len(scenario.rails))
    for b, rail in enumerate(scenario.rails):
        before = points[b - 1] if b > 0 and scenario.rails[b - 1] == rail else 0
        points[b] = before + fresh[b]
    blocks = np.maximum(points / scenario.support(), 1.0)
    degrees_of_freedom = np.maximum(points - len(scenario.known.curve.free), 1)
    return truth._replace(
        bound=truth.bound / np.sqrt(blocks)[:, None], quantile=stdtrit(degrees_of_freedom, 0.975)
    )


def _count(
    tally: dict[int, Moments],
    rows: list[_Row],
    scenario: Scenario,
    estimates: Mapping[str, Estimate],
    optima: Mapping[str, Estimate],
    tracking: Mapping[str, Tracking],
    truths: Mapping[str, Truth],
) -> None:
    """Add the runs of a tile to the sums behind every row of every table."""
    outcomes = {
        name: _outcome(scenario, truths[name].names, e, optima[name], tracking[name])
        for name, e in estimates.items()
    }
    for index, row in enumerate(rows):
        outcome = outcomes[row.identifier]
        truth = truths[row.identifier]
        part = Moments.of(run_statistics(outcome, truth, row.group.blocks, row.group.switched))
        tally[index] = tally[index].plus(part) if index in tally else part


def _on_box(scenario: Scenario, estimate: Estimate) -> np.ndarray:
    known = scenario.known
    if not set(known.curve.free) <= set(estimate.values):  # a method without a curve
        return np.zeros(estimate.status.shape, dtype=bool)
    parameters = values_of(estimate, known.curve.free)
    return np.asarray(_any_on_bound(parameters, known.lower, known.upper))


@kept()
def _any_on_bound(
    parameters: Float[ArrayLike, "*batch p"],
    lower: Float[ArrayLike, " p"],
    upper: Float[ArrayLike, " p"],
) -> Bool[Array, "*batch"]:
    return jnp.any(on_bound(parameters, lower, upper), axis=-1)


def _outcome(
    scenario: Scenario,
    names: Sequence[str],
    estimate: Estimate,
    optimum: Estimate,
    tracking: Tracking,
) -> Outcome:
    return Outcome(
        values=values_of(estimate, names),
        standard_errors=standard_errors(estimate, names),
        on_box=_on_box(scenario, estimate),
        unusable=np.isin(estimate.status, _UNUSABLE),
        objective=np.asarray(estimate.objective),
        optimum=np.asarray(optimum.objective),
        optimum_on_box=_on_box(scenario, optimum),
        evaluations=np.asarray(estimate.evaluations),
        delay=np.asarray(tracking.delay),
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
