"""A general method on the residual of a law: boosted trees, judged on runs not fitted to.

Trees know no catalogue: what they predict of runs that they have not seen is structure that the law
lacks, in whatever form. They claim no cause; they name the columns that they cannot do without.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import t as student
from sklearn.ensemble import HistGradientBoostingRegressor

from adhesion_jax.discovery.types import Opinion

_FOLDS = 4

#: Fewer runs leave too few to each fold.
_FEWEST_RUNS = 8

#: More points say no more of the columns, only take longer.
_POINTS = 4000

#: The opinion is heard at this p.
_SIGNIFICANT = 0.002

#: A column is named at this p, adjusted for all that could be.
_NAMED = 0.01

#: How much wider than independent ones the products of the runs are taken to scatter. Of 3,000
#: simulated campaigns of 28 runs with nothing to find (white noise, AR(1) of .3 to .95, levels that
#: scatter by up to twice the noise) 4 had p <= .002 and 27 p <= .01; without it, 23 and 64.
_WIDER = 1.2

#: Trees of the test, and of the longer fits that are tried once it has been passed.
_TREES, _MORE_TREES = 25, (75, 225)

#: How often each column is exchanged between runs.
_EXCHANGES = 3


def second_opinion(
    features: Mapping[str, np.ndarray],
    residual: np.ndarray,
    runs: np.ndarray,
    own: Sequence[str],
    seed: int,
) -> Opinion | None:
    """What boosted trees predict of the residual of runs left out; None where that may be chance.

    `features` are columns [points] of numbers; one with gaps is left out. `residual` [points] is
    measured less predicted adhesion, in any unit, its sign that of traction; `runs` [points] says
    which run a point is of. Columns that are `own` to the slip are used but not named.

    Four times a quarter of the runs is predicted, f, by trees fitted to the others. With e the
    residual of run r, the products u_r = mean of e f over the run have mean zero if the columns
    say nothing, whatever the noise within a run, if only the runs are independent. Each pair of
    runs of different quarters speaks twice, once either way round, so that the sum of u_r scatters
    wider than independent products would, at most sqrt(2) times: p is that of Student's t, made
    smaller by a factor that holds the level where the squared error falls as well.

    This is done for the residual, and for the residual less its mean over each run: where runs
    scatter, what happens within them is seen only in the second. p is adjusted for both.
    """
    if not np.any(residual):
        return None
    generator = np.random.default_rng([seed, 23])
    rows = np.arange(residual.size)
    if rows.size > _POINTS:
        # Drawn at random: every n-th row may be the same axle each time.
        rows = np.sort(generator.choice(rows, _POINTS, replace=False))
    names = [name for name, column in features.items() if np.ptp(column[rows]) > 0]
    _, run = np.unique(runs[rows], return_inverse=True)
    count = int(run.max()) + 1
    if count < _FEWEST_RUNS or not names:
        return None
    columns = np.column_stack([features[name][rows] for name in names])
    error = residual[rows] / np.sqrt(np.mean(residual[rows] ** 2))
    fold = (generator.permutation(count) % _FOLDS)[run]

    trials = [
        _trial(columns, left, run, fold, _TREES)
        for left in (error, error - _mean_by_run(error, run)[run])
    ]
    best = min(trials, key=lambda trial: trial.p)
    p = min(1.0, len(trials) * best.p)
    if p > _SIGNIFICANT:
        return None
    for trees in _MORE_TREES:
        longer = _trial(columns, best.left, run, fold, trees)
        if longer.gain.sum() <= best.gain.sum():
            break
        best = longer
    rise = _rise(best, columns, run, fold, generator)
    gain, before = best.gain, _mean_by_run(error**2, run)
    explained = gain.sum() / before.sum()
    spread = np.std(gain - explained * before, ddof=1) * np.sqrt(count) / before.sum()
    named = _named(rise, [place for place, name in enumerate(names) if name not in own])
    return Opinion(tuple(names[place] for place in named), float(explained), float(spread), p)


class _Trial(NamedTuple):
    """Trees on one kind of residual, each fold predicted by those that were not fitted to it."""

    left: np.ndarray  # what they are fitted to, [points]
    models: Sequence[HistGradientBoostingRegressor]  # [folds]
    squared: np.ndarray  # the squared error that they leave, [points]
    gain: np.ndarray  # mean squared error removed, [runs]
    p: float  # that they predict nothing; 1 where they remove nothing


def _trial(
    columns: np.ndarray, left: np.ndarray, run: np.ndarray, fold: np.ndarray, trees: int
) -> _Trial:
    models = _fitted(columns, left, fold, trees)
    told = _predicted(models, columns, fold)
    squared = (left - told) ** 2
    gain = _mean_by_run(left**2 - squared, run)
    p = _p_value(_mean_by_run(left * told, run)) if gain.sum() > 0 else 1.0
    return _Trial(left, models, squared, gain, p)


def _fitted(
    columns: np.ndarray, left: np.ndarray, fold: np.ndarray, trees: int
) -> list[HistGradientBoostingRegressor]:
    """For each fold the trees fitted to all the others."""
    return [
        HistGradientBoostingRegressor(
            max_iter=trees,
            learning_rate=0.08,
            max_leaf_nodes=8,
            min_samples_leaf=max(20, left.size // 40),
            max_bins=63,
            early_stopping=False,
            random_state=0,
        ).fit(columns[fold != k], left[fold != k])
        for k in range(_FOLDS)
    ]


def _predicted(
    models: Sequence[HistGradientBoostingRegressor], columns: np.ndarray, fold: np.ndarray
) -> np.ndarray:
    """Of every point by the trees that were not fitted to its fold, [points]."""
    told = np.empty(len(columns))
    for k, model in enumerate(models):
        told[fold == k] = model.predict(columns[fold == k])
    return told


def _mean_by_run(values: np.ndarray, run: np.ndarray) -> np.ndarray:
    return np.bincount(run, values) / np.bincount(run)


def _p_value(products: np.ndarray) -> float:
    """That the products of the runs have a mean above zero by chance, each pair told twice."""
    spread = max(float(np.std(products, ddof=1)), 1e-300)
    statistic = np.mean(products) * np.sqrt(products.size) / spread
    return float(student.sf(statistic / _WIDER, products.size - 1))


def _rise(
    trial: _Trial,
    columns: np.ndarray,
    run: np.ndarray,
    fold: np.ndarray,
    generator: np.random.Generator,
) -> np.ndarray:
    """By column and run, how much the squared error rises with the column of another run.

    [columns, runs]; the other run is of the same fold, so that no trees know either of them.
    """
    places = [np.flatnonzero(run == r) for r in range(int(run.max()) + 1)]
    rise = np.zeros((columns.shape[1], len(places)))
    for _ in range(_EXCHANGES):
        source = np.empty(run.size, dtype=int)
        for k in range(_FOLDS):
            order = generator.permutation(np.unique(run[fold == k]))
            for here, there in zip(order, np.roll(order, 1), strict=True):
                source[places[here]] = np.resize(places[there], places[here].size)
        for place in range(columns.shape[1]):
            other = columns.copy()
            other[:, place] = columns[source, place]
            worse = (trial.left - _predicted(trial.models, other, fold)) ** 2
            rise[place] += _mean_by_run(worse - trial.squared, run) / _EXCHANGES
    return rise


def _named(rise: np.ndarray, candidates: Sequence[int]) -> Sequence[int]:
    """The candidates without which runs are predicted worse, by a t test over the runs."""
    mean = rise.mean(axis=1)
    spread = rise.std(axis=1, ddof=1) / np.sqrt(rise.shape[1])
    needed = student.ppf(1 - _NAMED / max(len(candidates), 1), rise.shape[1] - 1)
    kept = [place for place in candidates if mean[place] > needed * spread[place] > 0]
    return sorted(kept, key=lambda place: -mean[place])
