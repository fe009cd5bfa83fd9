"""Boosted trees on the residual of a law, judged on runs that they were not fitted to.

The trees know no catalogue: what they predict of runs left out is structure that the law lacks, in
whatever form. They claim no cause; the columns that they need for the prediction are reported.
"""

from collections.abc import Container, Mapping, Sequence
from functools import partial
from importlib import import_module
from threading import Thread
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy

from adhesion_jax.discovery.model.problem import Problem, label_of
from adhesion_jax.discovery.search import rules
from adhesion_jax.discovery.search.state import Selection
from adhesion_jax.discovery.types import Opinion
from adhesion_jax.inference.sums import TUNING

if TYPE_CHECKING:
    from sklearn.ensemble import HistGradientBoostingRegressor

#: Largest number of folds of the cross-validation over runs, each of two runs at least.
_FOLDS = 8

#: Largest number of points that the trees are fitted to; of more points as many are drawn.
_POINTS = 4000

#: Number of trees of the test.
_TREES = 25

#: Numbers of trees that are tried after a passed test, as long as the gain grows.
_MORE_TREES = (75, 225)

#: Number of random exchanges of each column between runs.
_EXCHANGES = 3


def import_trees() -> None:
    """Import the library of the trees, which takes longer than their work, beside what runs now."""
    Thread(target=import_module, args=("sklearn.ensemble",), daemon=True).start()


def features_of(
    problem: Problem, slip: np.ndarray, columns: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """What the trees know of points [points]: the columns of a problem, and what is of the slip."""
    known = {label_of(name, problem.measured): columns[name] for name in problem.columns}
    return {**known, "slip_ratio": np.abs(slip), "mode": np.sign(slip)}


def known_of(state: Selection, without: Container[str]) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """What the trees know of the training points, and what the law leaves there, [points].

    They do not know the columns `without`. The sign of the residual is that of traction.
    """
    problem = state.setting.problem
    inside = problem.points > 0
    slip = np.asarray(problem.data.slip)[inside]
    known = features_of(problem, slip, problem.flat)
    features = {name: column for name, column in known.items() if name not in without}
    return features, state.fitted.error[inside] * np.sign(slip)


def second_opinion(
    features: Mapping[str, np.ndarray],
    residual: np.ndarray,
    runs: np.ndarray,
    own: Sequence[str],
    seed: int,
) -> Opinion | None:
    """What boosted trees predict of the residual of runs left out; None if that is likely chance.

    A hint, of which chance is not excluded, has no columns and no correction.

    `features` are columns [points] of numbers; one with gaps is left out. `residual` [points] is
    measured less predicted adhesion, in any unit, its sign that of traction; `runs` [points] is the
    run of each point. Columns in `own` belong to the slip: they are used but not named.

    The runs of each fold are predicted by trees fitted to the other runs. With e the residual, cut
    at `TUNING` standard deviations as in every fit of a law, and f the prediction, the products
    u_r = mean of e f over run r have mean zero if the columns are unrelated to e, whatever the
    noise within a run, as long as the runs are independent. Each pair of runs of different folds
    enters twice, so that the sum of u_r scatters wider than independent products would, at most
    sqrt(2) times: p is that of Student's t divided by `rules.OPINION_WIDENING`, and 1 if the
    squared error does not fall.

    This is done for the residual, and for the residual less its mean over each run: if the levels
    of the runs scatter, structure within the runs shows only in the second. p is adjusted for both.
    """
    generator = np.random.default_rng([seed, 23])
    rows = np.arange(residual.size)
    if rows.size > _POINTS:
        # Drawn at random: every n-th row might be of the same axle.
        rows = np.sort(generator.choice(rows, _POINTS, replace=False))
    names = [name for name, column in features.items() if np.ptp(column[rows]) > 0]
    _, run = np.unique(runs[rows], return_inverse=True)
    count = int(run.max()) + 1
    far = TUNING * 1.4826 * float(np.median(np.abs(residual[rows])))
    if count < rules.FEWEST_RUNS or not names or far == 0:
        return None
    columns = np.column_stack([features[name][rows] for name in names])
    error = np.clip(residual[rows], -far, far)
    unit = float(np.sqrt(np.mean(error**2)))
    error = error / unit
    fold = (generator.permutation(count) % min(_FOLDS, count // 2))[run]

    trials = [
        _trial(columns, left, run, fold, _TREES)
        for left in (error, error - _mean_by_run(error, run)[run])
    ]
    best = min(trials, key=lambda trial: trial.p)
    p = min(1.0, len(trials) * best.p)
    if p > rules.OPINION_HINTED:
        return None
    before = _mean_by_run(error**2, run)
    if p > rules.OPINION_SIGNIFICANT:
        return Opinion((), *_explained(best.gain, before), p)
    size = _TREES
    for trees in _MORE_TREES:
        longer = _trial(columns, best.left, run, fold, trees)
        if longer.gain.sum() <= best.gain.sum():
            break
        best, size = longer, trees
    rise = _rise(best, columns, run, fold, generator)
    explained, spread = _explained(best.gain, before)
    named = _named(rise, [place for place, name in enumerate(names) if name not in own])
    correction = None
    if explained > spread:
        model = _fitted(columns, best.left, size, _leaf(run.size))
        correction = partial(_corrected, model, tuple(names), unit)
    of = tuple(names[place] for place in named)
    return Opinion(of, explained, spread, p, correction)


def predicted_by_trees(
    features: Mapping[str, np.ndarray], residual: np.ndarray, columns: Mapping[str, np.ndarray]
) -> np.ndarray:
    """What boosted trees predict of a residual, [points], whether or not that is likely chance.

    They have the sizes that their library gives them, and are fitted to the `features` [training
    points] for a comparison with them on the `columns` [points] of a test.
    """
    from sklearn.ensemble import HistGradientBoostingRegressor

    known = np.column_stack([*features.values()])
    trees = HistGradientBoostingRegressor(random_state=0).fit(known, residual)
    return trees.predict(np.column_stack([columns[name] for name in features]))


def _explained(gain: np.ndarray, before: np.ndarray) -> tuple[float, float]:
    """The share of the squared error that is removed, and its standard error over runs [runs]."""
    explained = gain.sum() / before.sum()
    spread = np.std(gain - explained * before, ddof=1) * np.sqrt(gain.size) / before.sum()
    return float(explained), float(spread)


def _corrected(
    model: "HistGradientBoostingRegressor",
    names: Sequence[str],
    unit: float,
    columns: Mapping[str, np.ndarray],
) -> np.ndarray:
    return unit * model.predict(np.column_stack([columns[name] for name in names]))


class _Trial(NamedTuple):
    """Cross-validated predictions of one kind of residual."""

    left: np.ndarray  # what they are fitted to, [points]
    models: "Sequence[HistGradientBoostingRegressor]"  # [folds]
    squared: np.ndarray  # the squared error that they leave, [points]
    gain: np.ndarray  # mean squared error removed, [runs]
    p: float  # of no relation; 1 if the squared error does not fall


def _trial(
    columns: np.ndarray, left: np.ndarray, run: np.ndarray, fold: np.ndarray, trees: int
) -> _Trial:
    leaf = _leaf(left.size)
    folds = range(int(fold.max()) + 1)
    models = [_fitted(columns[fold != k], left[fold != k], trees, leaf) for k in folds]
    predicted = _predicted(models, columns, fold)
    squared = (left - predicted) ** 2
    gain = _mean_by_run(left**2 - squared, run)
    p = _p_value(_mean_by_run(left * predicted, run)) if gain.sum() > 0 else 1.0
    return _Trial(left, models, squared, gain, p)


def _leaf(points: int) -> int:
    """The fewest points of a leaf, where there are so many in all."""
    return max(20, points // 40)


def _fitted(
    columns: np.ndarray, left: np.ndarray, trees: int, leaf: int
) -> "HistGradientBoostingRegressor":
    from sklearn.ensemble import HistGradientBoostingRegressor

    return HistGradientBoostingRegressor(
        max_iter=trees,
        learning_rate=0.08,
        max_leaf_nodes=8,
        min_samples_leaf=leaf,
        max_bins=63,
        early_stopping=False,
        random_state=0,
    ).fit(columns, left)


def _predicted(
    models: "Sequence[HistGradientBoostingRegressor]", columns: np.ndarray, fold: np.ndarray
) -> np.ndarray:
    """The prediction of every point by the trees not fitted to its fold, [points]."""
    predicted = np.empty(len(columns))
    for k, model in enumerate(models):
        predicted[fold == k] = model.predict(columns[fold == k])
    return predicted


def _mean_by_run(values: np.ndarray, run: np.ndarray) -> np.ndarray:
    return np.bincount(run, values) / np.bincount(run)


def _p_value(products: np.ndarray) -> float:
    """One-sided p of the mean of the products [runs], each pair of which entered twice."""
    spread = max(float(np.std(products, ddof=1)), 1e-300)
    statistic = np.mean(products) * np.sqrt(products.size) / spread
    return float(scipy.stats.t.sf(statistic / rules.OPINION_WIDENING, products.size - 1))


def _rise(
    trial: _Trial,
    columns: np.ndarray,
    run: np.ndarray,
    fold: np.ndarray,
    generator: np.random.Generator,
) -> np.ndarray:
    """The rise of the mean squared error of each run with a column of another run, [columns, runs].

    The other run is of the same fold, so that the trees were fitted to neither.
    """
    places = [np.flatnonzero(run == r) for r in range(int(run.max()) + 1)]
    rise = np.zeros((columns.shape[1], len(places)))
    for _ in range(_EXCHANGES):
        source = np.empty(run.size, dtype=int)
        for k in range(len(trial.models)):
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
    """The candidates whose exchange raises the error (t test over runs), the largest rise first."""
    mean = rise.mean(axis=1)
    spread = rise.std(axis=1, ddof=1) / np.sqrt(rise.shape[1])
    needed = scipy.stats.t.ppf(1 - rules.SIGNIFICANT / max(len(candidates), 1), rise.shape[1] - 1)
    kept = [place for place in candidates if mean[place] > needed * spread[place] > 0]
    return sorted(kept, key=lambda place: -mean[place])
