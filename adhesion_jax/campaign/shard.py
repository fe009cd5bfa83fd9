"""A shard: some runs of all methods of a job, a function of the job and the shard's number alone.

It may be computed anywhere and in any order. What adds up is added in the order of the runs within
a shard, and in that of the shards afterwards, so that sums are the same bit for bit whatever is
computed where.
"""

from collections.abc import Mapping, Sequence

import jax
import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from adhesion_jax.campaign.job import REFERENCE, Job
from adhesion_jax.campaign.rows import Found, estimate_rows
from adhesion_jax.campaign.store import Content, Tell
from adhesion_jax.campaign.tiles import TILE, TileResult, Tiles
from adhesion_jax.identifiers import Identifier, Status
from adhesion_jax.inference.sandwich import COSINES
from adhesion_jax.metrics.accuracy import Outcome, Truth, run_statistics
from adhesion_jax.metrics.counts import BINS, bins_of, share_bins_of
from adhesion_jax.metrics.information import quantity_names
from adhesion_jax.metrics.moments import Moments
from adhesion_jax.metrics.tracking import delay_counts, lags, tracking_statistics
from adhesion_jax.optim.box import on_bound
from adhesion_jax.records import Record
from adhesion_jax.runtime import silent
from adhesion_jax.scenarios import Scenario
from adhesion_jax.scenarios.course import switches

#: Statuses that count as a failure for every method.
_UNUSABLE = (Status.NO_PEAK, Status.INADMISSIBLE, Status.NOT_FINITE)

#: Where a quantity has no bound, this share of its true value takes its place as a scale.
_SHARE_OF_TRUTH = 0.01

#: Successive numbers times this, modulo one, are far apart.
_GOLDEN_SECTION = 0.618033988749895


def content(job: Job, number: int, tell: Tell = silent) -> Content:
    """The shard of this number: what its runs add up to, and the estimates that are kept.

    Each run is drawn once, for all methods. The arrays are the moments of `run_statistics`
    ("accuracy", [rows] or [rows, quantities]), of `tracking_statistics` ("tracking", [names,
    stretches]) and of the time of one identification ("seconds", [methods], whose runs are tiles);
    the runs with each delay, [names, stretches, steps]; the places in the counts [names, blocks,
    counted quantities, BINS] that are not zero, with the numbers there; and the seconds to compile.
    """
    config, scenario, of_tile = job.config, job.scenario, job.tiles
    parts: dict[str, list[Found]] = {name: [] for name in job.methods}
    seconds, compile_seconds = [], dict.fromkeys(job.methods, 0.0)
    bounds = []
    tiles = job.tiles_of(number)
    for tile in tiles:
        if tile * TILE >= config.runs:
            break
        done = (tile - tiles.start) * TILE
        tell(done, f"noise of {config.scenario}")
        records = of_tile.draw(config.seed, tile)
        bounds.append(np.asarray(of_tile.bound(records)))
        spent = {}
        for name in _rotated(job.methods, number):
            tell(done, f"{name} on {config.scenario}")
            result = of_tile.identify(config.seed, tile, name, job.methods[name], records)
            parts[name].append(_found(of_tile, job.methods[name], records, result))
            spent[name] = result.seconds / (TILE * len(scenario.rails))
            compile_seconds[name] = max(compile_seconds[name], result.compile_seconds)
        seconds.append([spent[name] for name in job.methods])
    runs = job.runs_of(number)
    found = {
        name: jax.tree.map(lambda *x: np.concatenate(x)[:runs], *of_name)
        for name, of_name in parts.items()
    }
    truth, longest = truth_of(scenario, np.concatenate(bounds)[:runs]), job.longest
    rows = estimate_rows(
        config.scenario,
        scenario,
        {n: found[n] for n in job.names},
        tiles.start * TILE,
        job.kept_blocks,
    )
    pool = _pooled(scenario, np.asarray(records.fresh), truth)
    places, numbers = _counts(job, found)
    arrays = {
        **_accuracy(job, found, truth, pool).arrays("accuracy"),
        **_tracking(job, found, truth, records.fresh.shape[-1]).arrays("tracking"),
        **Moments.of({"seconds": np.array(seconds)}).arrays("seconds"),
        "delays": np.stack([delay_counts(found[name].tracking, longest) for name in job.names]),
        "places": places,
        "numbers": numbers,
        "compile_seconds": np.array([*compile_seconds.values()]),
    }
    return Content(arrays, rows)


def _rotated(methods: Mapping[str, Identifier], number: int) -> Sequence[str]:
    """The methods, rotated by shard, so that processes do not compile the same program first."""
    names = [*methods]
    first = int(len(names) * (number * _GOLDEN_SECTION % 1))
    return names[first:] + names[:first]


def _found(tiles: Tiles, method: Identifier, records: Record, result: TileResult) -> Found:
    estimate, known = result.estimate, tiles.scenario.known
    errors = np.sqrt(np.diagonal(estimate.covariance, axis1=-2, axis2=-1))
    values = {name: np.asarray(value) for name, value in estimate.values.items()}
    on_box = np.zeros(estimate.status.shape, dtype=bool)
    by_cosines = dict.fromkeys(values, np.full(estimate.status.shape, np.nan))
    if set(known.curve.free) <= set(values):  # else it is a method without a curve
        parameters = np.stack([values[name] for name in known.curve.free], axis=-1)
        on_box = np.any(on_bound(parameters, np.asarray(known.lower), np.asarray(known.upper)), -1)
        if method.FITS_LAST_RECORD:
            found = np.moveaxis(np.asarray(tiles.cosine_errors((records, parameters))), -1, 0)
            by_cosines |= dict(zip(quantity_names(known.curve), found, strict=True))
    return Found(
        values=values,
        standard_errors={name: errors[..., i] for i, name in enumerate(values)},
        cosine_errors=by_cosines,
        on_box=on_box,
        status=np.asarray(estimate.status),
        objective=np.asarray(estimate.objective),
        kept_share=np.where(estimate.reset, 0.0, estimate.forgetting),
        evaluations=np.asarray(estimate.evaluations),
        tracking=result.tracking,
    )


def truth_of(scenario: Scenario, bound: NDArray[np.float64]) -> Truth:
    """The true values of a scenario, and the bound of each run."""
    quantities = scenario.quantities()
    degrees_of_freedom = np.maximum(scenario.support() - len(scenario.known.curve.free), 1)
    return Truth(
        names=tuple(quantities),
        values=np.stack(list(quantities.values()), axis=-1),
        bound=bound,
        sigma=scenario.noise.sigma,
        quantile=stdtrit(degrees_of_freedom, 0.975),
    )


def _pooled(scenario: Scenario, fresh: NDArray[np.bool_], truth: Truth) -> Truth:
    """The truth for a method that pools the blocks since the rail last changed.

    The blocks of a rail have equal information, so that the bound of a pool of k is smaller by the
    root of k. A block that contains the points of those before it is such a pool already.
    """
    fresh = fresh.sum(axis=-1)
    points = np.zeros(len(scenario.rails))
    for b, rail in enumerate(scenario.rails):
        before = points[b - 1] if b > 0 and scenario.rails[b - 1] == rail else 0
        points[b] = before + fresh[b]
    blocks = np.maximum(points / scenario.support(), 1.0)
    degrees_of_freedom = np.maximum(points - len(scenario.known.curve.free), 1)
    return truth._replace(
        bound=truth.bound / np.sqrt(blocks)[:, None], quantile=stdtrit(degrees_of_freedom, 0.975)
    )


def _accuracy(job: Job, found: Mapping[str, Found], truth: Truth, pool: Truth) -> Moments:
    """The moments of every row of every table of accuracy; `pool` is for methods that pool."""
    of_row = []
    outcomes = {name: _outcome(job, name, found, truth.names) for name in job.names}
    for row in job.rows:
        whose = pool if job.methods[row.identifier].POOLS else truth
        outcome = outcomes[row.identifier]
        of_row.append(run_statistics(outcome, whose, row.group.blocks, row.group.switched))
    return Moments.of({name: np.stack([r[name] for r in of_row], axis=1) for name in of_row[0]})


def _outcome(job: Job, name: str, found: Mapping[str, Found], quantities: Sequence[str]) -> Outcome:
    one = found[name]
    # A gap to the exact optimum is a failure only if the optimum is known and minimised.
    fits, none = job.methods[name].FITS_LAST_RECORD, np.zeros_like(one.objective)
    # A method may leave out other quantities than the one that is asked for first.
    lost = ~np.isfinite(one.values[job.scenario.known.asked[0]])
    optimum = found.get(REFERENCE, one) if fits else one
    values, errors, robust = (
        np.stack([of[quantity] for quantity in quantities], axis=-1)
        for of in (one.values, one.standard_errors, one.cosine_errors)
    )
    return Outcome(
        values=values,
        standard_errors=errors,
        robust=stdtrit(COSINES, 0.975) * robust,
        on_box=one.on_box,
        unusable=np.isin(one.status, _UNUSABLE) | lost,
        objective=one.objective if fits else none,
        optimum=optimum.objective if fits else none,
        optimum_on_box=optimum.on_box,
        evaluations=one.evaluations,
        delay=np.asarray(one.tracking.delay),
    )


def _tracking(job: Job, found: Mapping[str, Found], truth: Truth, points: int) -> Moments:
    steps = points if job.scenario.known.by_sample else 1
    rails = job.scenario.rails
    stretch = np.searchsorted(switches(rails), np.arange(len(rails)), side="right")

    def lag(one: Found) -> NDArray[np.float64]:
        if "mu_max" not in truth.names:
            return np.full(one.tracking.delay.shape, np.nan)
        place = truth.names.index("mu_max")
        return lags(one.values["mu_max"], truth.values[:, place], stretch, steps)

    of_name = [tracking_statistics(found[name].tracking, lag(found[name])) for name in job.names]
    return Moments.of({key: np.stack([s[key] for s in of_name], axis=1) for key in of_name[0]})


def _counts(job: Job, found: Mapping[str, Found]) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """The estimates after each block counted in bins: the places that are not zero, the numbers."""
    centre, scale = scales(job.tiles)
    asked, blocks, quantities = job.scenario.quantities(), len(centre), len(job.counted)
    every = np.arange(blocks * quantities).reshape(blocks, quantities) * BINS
    places, numbers = [], []
    for place, name in enumerate(job.names):
        one = found[name]
        values = np.stack([one.values[q] for q in asked], axis=-1)
        bins = bins_of(values, centre, scale)
        if quantities > bins.shape[-1]:
            bins = np.concatenate([bins, share_bins_of(one.kept_share)[..., None]], axis=-1)
        # Sorted, and not counted in an array of all places, of which few have a run.
        there, count = np.unique((bins + every)[bins < BINS], return_counts=True)
        places.append(there + place * every.size * BINS)
        numbers.append(count.astype(np.int32))
    return np.concatenate(places), np.concatenate(numbers)


def scales(tiles: Tiles) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The truth and the scale about which estimates are counted, [blocks, quantities] each.

    The scale is the bound of the runs of one tile, which stands for that of all.
    """
    bound = np.asarray(tiles.bound(tiles.draw(0, 0)))
    truth = truth_of(tiles.scenario, bound).values
    bound = np.sqrt(np.mean(bound**2, axis=0))
    without = np.where(truth == 0, 1.0, _SHARE_OF_TRUTH * np.abs(truth))
    return truth, np.where(np.isfinite(bound) & (bound > 0), bound, without)
