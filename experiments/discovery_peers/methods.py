"""The peers of the discovery: general methods for the residual of a base curve.

Each answers with the residual that it predicts on the test table and the columns that it names as
causes. All are told the best base curve.
"""

import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import combinations_with_replacement
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.stats import t as student

from experiments.campaigns.base import rms
from experiments.discovery_peers.features import OWN, Base, Problem, folds, make_problem

#: Level of the test by which trees and Gaussian processes name columns, over all columns.
_LEVEL = 0.01


class Prediction(NamedTuple):
    adhesion: np.ndarray  # of the test table, [rows]
    named: tuple[str, ...]  # columns


#: The residual on the rows of the test, and the columns that are named.
Answer = tuple[np.ndarray, tuple[str, ...]]


def sparse_regression(problem: Problem) -> Answer:
    """STLSQ on all terms up to the second degree; threshold and ridge cross-validated by run."""
    from pysindy import STLSQ

    terms = [
        term
        for degree in (1, 2)
        for term in combinations_with_replacement(range(len(problem.columns)), degree)
    ]
    library, test_library = (_terms(part, terms) for part in (problem.train, problem.test))
    # Columns of unit spread: a threshold is then a share of the spread of the residual.
    spread = np.maximum(library.std(axis=0), 1e-12)
    library, test_library = library / spread, test_library / spread
    scale = rms(problem.residual)

    def fit(setting: tuple[float, float], rows: np.ndarray) -> np.ndarray:
        threshold, ridge = setting
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a result without any term is valid
            solver = STLSQ(threshold=threshold, alpha=ridge * rows.size, max_iter=10)
            solver.fit(library[rows], problem.residual[rows, None] / scale)
        return np.asarray(solver.coef_).ravel() * scale

    def fitted_with(setting: tuple[float, float], rows: np.ndarray) -> np.ndarray:
        return library @ fit(setting, rows)

    # There are more terms than runs: without a ridge the coefficients of columns that are constant
    # in a run would diverge.
    settings = [
        (threshold, ridge)
        for threshold in (0.04, 0.08, 0.12, 0.2, 0.4, 1e3)
        for ridge in (1e-6, 0.01, 0.1)
    ]
    errors = {
        setting: float(_cross_validated(problem, partial(fitted_with, setting)).mean())
        for setting in settings
    }
    weights = fit(min(errors, key=lambda setting: errors[setting]), np.arange(len(library)))
    chosen = {problem.columns[j] for term, w in zip(terms, weights, strict=True) if w for j in term}
    named = (name for name in problem.columns if name in chosen and name not in OWN)
    return test_library @ weights, tuple(named)


def gaussian_process(problem: Problem) -> Answer:
    """Length scales by column and white noise, on 800 points spread over all runs."""
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    scale = rms(problem.residual)
    rows = np.linspace(0, len(problem.train) - 1, min(800, len(problem.train))).astype(int)
    width = len(problem.columns)
    kernel = ConstantKernel(0.3, (1e-4, 1e2)) * RBF(np.full(width, 3.0), (0.1, 1e3)) + WhiteKernel(
        0.7, (1e-4, 1e1)
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a length scale at its bound is a column without influence
        process = GaussianProcessRegressor(kernel).fit(
            problem.train[rows], problem.residual[rows] / scale
        )
    fixed = process.kernel_

    def fit(chosen: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        thinned = np.intersect1d(chosen, rows)
        part = GaussianProcessRegressor(fixed, optimizer=None).fit(
            problem.train[thinned], problem.residual[thinned] / scale
        )
        return lambda features: np.asarray(part.predict(features)) * scale

    named = _important(problem, fit, rows)
    return np.asarray(process.predict(problem.test)) * scale, named


def boosted_trees(problem: Problem) -> Answer:
    """Histogram gradient boosting; its length cross-validated by run."""
    from sklearn.ensemble import HistGradientBoostingRegressor

    def fit(trees: int, rows: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        if trees == 0:
            return lambda features: np.zeros(len(features))
        model = HistGradientBoostingRegressor(
            max_iter=trees, learning_rate=0.08, min_samples_leaf=40, random_state=0
        ).fit(problem.train[rows], problem.residual[rows])
        return lambda features: np.asarray(model.predict(features))

    def fitted_with(trees: int, rows: np.ndarray) -> np.ndarray:
        return fit(trees, rows)(problem.train)

    errors = {
        trees: _cross_validated(problem, partial(fitted_with, trees)) for trees in (0, 20, 60, 200)
    }
    best = min(errors, key=lambda trees: float(errors[trees].mean()))
    named = _important(problem, lambda rows: fit(best, rows)) if best else ()
    model = fit(best, np.arange(len(problem.train)))
    return model(problem.test), named


#: Each method, and whether it has lags, rates, filtered sand and the work done in a run besides.
PEERS: Mapping[str, tuple[Callable[[Problem], Answer], bool]] = {
    "sparse-regression": (sparse_regression, False),
    "trees": (boosted_trees, False),
    "trees-dynamic": (boosted_trees, True),
    "gaussian-process": (gaussian_process, False),
}


def predicted(method: str, train: pd.DataFrame, test: pd.DataFrame, base: Base) -> Prediction:
    """The answer of a method of PEERS, on one thread: more than there are cores slow it tenfold."""
    from threadpoolctl import threadpool_limits

    answer, dynamic = PEERS[method]
    with threadpool_limits(1):
        residual, named = answer(make_problem(train, test, base, dynamic))
    sign = np.sign(test["slip_ratio"].to_numpy(float))
    return Prediction(base.test + sign * residual, named)


def _cross_validated(problem: Problem, predict: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Mean squared error of each run when its fold was held out; `predict(rows to fit)` [rows]."""
    squared = np.empty(len(problem.residual))
    for fold in folds(problem.runs):
        kept = np.setdiff1d(np.arange(len(problem.residual)), fold)
        squared[fold] = (problem.residual[fold] - predict(kept)[fold]) ** 2
    return np.array([squared[problem.runs == run].mean() for run in np.unique(problem.runs)])


def _important(
    problem: Problem,
    fit: Callable[[np.ndarray], Callable[[np.ndarray], np.ndarray]],
    among: np.ndarray | None = None,
) -> tuple[str, ...]:
    """Columns without which held-out runs are predicted worse, by a t test over the runs.

    A column is taken away by giving each run that of another run.
    """
    rows = np.arange(len(problem.residual)) if among is None else among
    runs = problem.runs[rows]
    names = np.unique(runs)
    rise = np.zeros((len(problem.columns), names.size))
    generator = np.random.default_rng(1)
    for fold in folds(runs):
        kept = np.setdiff1d(np.arange(rows.size), fold)
        predict = fit(rows[kept])
        features, residual = problem.train[rows[fold]], problem.residual[rows[fold]]
        whole = (residual - predict(features)) ** 2
        places = [np.flatnonzero(runs[fold] == name) for name in np.unique(runs[fold])]
        for j in range(len(problem.columns)):
            for _ in range(3):
                shuffled = features.copy()
                for here, there in _derangement(places, generator):
                    shuffled[here, j] = np.resize(features[there, j], here.size)
                worse = (residual - predict(shuffled)) ** 2 - whole
                for here in places:
                    rise[j, names == runs[fold][here[0]]] += worse[here].mean() / 3
    error = rise.std(axis=1, ddof=1) / np.sqrt(names.size)
    candidates = [j for j, name in enumerate(problem.columns) if name not in OWN]
    quantile = student.ppf(1 - _LEVEL / len(candidates), names.size - 1)
    return tuple(problem.columns[j] for j in candidates if rise[j].mean() > quantile * error[j] > 0)


def _derangement(
    places: Sequence[np.ndarray], generator: np.random.Generator
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Each run with the next in a random order."""
    order = generator.permutation(len(places))
    return [(places[a], places[b]) for a, b in zip(order, np.roll(order, 1), strict=True)]


def _terms(features: np.ndarray, terms: Sequence[tuple[int, ...]]) -> np.ndarray:
    return np.stack([np.prod(features[:, term], axis=1) for term in terms], axis=1)
