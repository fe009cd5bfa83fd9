"""Whether the remaining levels of the runs follow a column that differs between runs."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from adhesion_jax.discovery.search import rules

#: Degree of the polynomial in the ranks of the runs that stands for a smooth function of a column.
_DEGREE = 3

#: Number of permutations of the levels.
_PERMUTATIONS = 1999


class Followed(NamedTuple):
    """A column that the levels of the runs follow."""

    column: str
    explained: float  # share of the variance of the levels, adjusted for the degrees of freedom
    p: float  # adjusted for all columns


def followed(levels: np.ndarray, columns: Mapping[str, np.ndarray], seed: int) -> Followed | None:
    """The column [runs] that explains most of the variance of the levels [runs], with its p.

    A column explains what a polynomial of the third degree in the ranks of its values does, by
    least squares: this assumes no form but a smooth one, and a run far out does not weigh more. p
    is the share of permutations of the levels in which any column explains as much. None for too
    few runs, without a column of more than three values, and for levels that are all equal.
    """
    runs = levels.size
    varying = {name: values for name, values in columns.items() if np.unique(values).size > _DEGREE}
    if runs < rules.FEWEST_RUNS_OF_LEVELS or not varying or not np.ptp(levels) > 0:
        return None
    generator = np.random.default_rng([seed, 29])
    permuted = generator.permuted(np.tile(levels, (_PERMUTATIONS, 1)), axis=1).T
    trials = np.column_stack([levels, permuted]) - levels.mean()
    trials /= np.linalg.norm(levels - levels.mean())
    explained = np.stack([_explained(values, trials) for values in varying.values()])
    best = int(np.argmax(explained[:, 0]))
    exceeded = int(np.sum(explained[:, 1:].max(axis=0) >= explained[best, 0]))
    left = (1 - explained[best, 0]) * (runs - 1) / (runs - 1 - _DEGREE)
    return Followed(list(varying)[best], float(1 - left), (1 + exceeded) / (1 + _PERMUTATIONS))


def _explained(values: np.ndarray, trials: np.ndarray) -> np.ndarray:
    """Share of the squares of each trial [runs, trials] that a polynomial in `values` explains."""
    rank = np.unique(values, return_inverse=True)[1].astype(float)
    place = 2 * rank / rank.max() - 1
    basis, _ = np.linalg.qr(np.vander(place, _DEGREE + 1))
    mean = trials.mean(axis=0)
    return ((basis.T @ trials) ** 2).sum(axis=0) - trials.shape[0] * mean**2
