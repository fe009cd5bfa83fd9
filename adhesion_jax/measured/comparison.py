"""Whether the rail changed between runs, or between groups of rows: tests of level and of shape."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import pandas as pd
import scipy
from jaxtyping import Float, Int

from adhesion_jax.inference.fit import MeasuredFit
from adhesion_jax.inference.rows import Rows

#: Largest number of groups that are compared.
MOST_GROUPS = 1000

#: A largest adhesion whose ends are further apart than this factor is not known.
WIDEST = 2.0

#: A change between groups is claimed if its p is at most this.
_SIGNIFICANT = 0.01

#: A group of fewer pieces is cut into this number of stretches, whose scatter judges it.
_STRETCHES = 6


class Comparison(NamedTuple):
    """The largest adhesion of each group, and the tests that all are alike.

    The table has a row a group: its name, runs, points, and under one curve mu_max, mu_max_se,
    mu_max_lo and mu_max_hi, of which the last three are NaN where the points do not determine it.
    """

    by: str
    table: pd.DataFrame
    statistic: float  # F if no level changed
    differences: int
    degrees: float  # of freedom of the scatter within the groups
    p: float  # that all levels are alike
    p_shape: float  # that the course over slip is alike
    run_scatter: float  # standard deviation of the levels within groups, relative

    @property
    def changed(self) -> bool:
        return self.p <= _SIGNIFICANT

    @property
    def bent(self) -> bool:
        return self.p_shape <= _SIGNIFICANT


class Pieces(NamedTuple):
    """Stretches of one group each: their levels under one curve, relative, and their weight."""

    group: Int[np.ndarray, " pieces"]
    level: Float[np.ndarray, " pieces"]
    shape: Float[np.ndarray, " pieces"]
    weight: Float[np.ndarray, " pieces"]
    shape_weight: Float[np.ndarray, " pieces"]


def pieces_of(fit: MeasuredFit, rows: Rows, group: Int[np.ndarray, " rows"]) -> Pieces:
    """Level and shape of every piece: the rows of one group in one run.

    The residual is regressed on the curve, and on the curve times the logarithm of slip less its
    mean. Groups of fewer than six pieces are cut into as many stretches: what varies slowly within
    a run then counts as scatter.
    """
    law = fit.law
    # Rows of groups may stand in turn: what is alike in neighbours is so within a group.
    order = np.lexsort((group, rows.run))
    group, run, weight = group[order], rows.run[order], rows.design[order]
    place = np.log1p(np.abs(rows.slip[order]) / law.span.reach)
    mean = fit.at_rows(rows, slice(None))[0][order]
    left = rows.adhesion[order] - mean
    limit = 3 * fit.noise.sigma + 0.1 * float(np.abs(mean).max())
    left = np.clip(left, -limit, limit)
    new = np.append(True, (np.diff(run) != 0) | (np.diff(group) != 0))
    count = np.bincount(group[new])
    starts = [
        first + np.linspace(0, last - first, pieces, endpoint=False).astype(int)
        for first, last, pieces in zip(
            np.flatnonzero(new),
            np.append(np.flatnonzero(new)[1:], group.size),
            -(-_STRETCHES // np.maximum(count[group[new]], 1)),
            strict=True,
        )
    ]
    begin = np.unique(np.concatenate(starts))
    cross, weight = weight * mean * left, weight * mean**2
    place = place - float(weight @ place) / float(weight.sum())

    def total(column: np.ndarray) -> np.ndarray:
        return np.add.reduceat(column, begin)

    size = np.maximum(total(weight), 1e-300)
    middle = total(weight * place) / size
    inner = np.maximum(total(weight * place**2) - size * middle**2, 1e-12 * size)
    level = total(cross) / size
    shape = (total(cross * place) - middle * total(cross)) / inner
    return Pieces(group[begin], level, shape, size, inner)


def analysed(
    values: Float[np.ndarray, " pieces"],
    weight: Float[np.ndarray, " pieces"],
    group: Int[np.ndarray, " pieces"],
) -> tuple[Float[np.ndarray, " groups"], float, float, float]:
    """Weighted means of the groups, F between them, its degrees of freedom within, and the scatter.

    One-way analysis of variance; the weights are relative precisions of the values.
    """
    count = int(group.max()) + 1
    size = np.bincount(group, weight, count)
    mean = np.bincount(group, weight * values, count) / size
    degrees = float(values.size - count)
    within = float(weight @ (values - mean[group]) ** 2) / max(degrees, 1.0)
    between = float(size @ (mean - float(size @ mean) / size.sum()) ** 2) / (count - 1)
    return mean, between / max(within, 1e-300), degrees, within


def compared(fit: MeasuredFit, rows: Rows, labels: pd.Series, by: str) -> Comparison:
    """The levels of the groups under one curve; `labels` is the group of each row, in their order.

    Source: Fisher's analysis of variance over runs, or stretches of them.
    """
    codes, names = pd.factorize(labels)
    pieces = pieces_of(fit, rows, codes)
    level, statistic, degrees, within = analysed(pieces.level, pieces.weight, pieces.group)
    _, bend, _, _ = analysed(pieces.shape, pieces.shape_weight, pieces.group)
    count = len(names)
    size = np.bincount(pieces.group, pieces.weight, count)
    # Beyond the points a curve says nothing of a rail: the largest adhesion is that among them.
    last = min(float(fit.peak.slip), fit.law.span.largest)
    mu_max = float(fit.law.at(np.array([last])).adhesion[0])
    height = mu_max * (1 + level)
    se = mu_max * np.sqrt(within / size + (fit.mu_max_se / float(fit.peak.adhesion)) ** 2)
    half = float(scipy.special.stdtrit(max(degrees, 1.0), 0.975)) * se / np.maximum(height, 1e-300)
    se, half = (np.where(2 * half <= np.log(WIDEST), told, np.nan) for told in (se, half))
    runs = pd.Series(rows.run).groupby(codes).nunique()
    table = pd.DataFrame(
        {
            by: names,
            "runs": runs.to_numpy(),
            "points": np.bincount(codes, minlength=count),
            "mu_max": height,
            "mu_max_se": se,
            "mu_max_lo": height * np.exp(-half),
            "mu_max_hi": height * np.exp(half),
        }
    )
    f = scipy.stats.f
    return Comparison(
        by,
        table,
        statistic,
        count - 1,
        degrees,
        float(f.sf(statistic, count - 1, degrees)),
        float(f.sf(bend, count - 1, degrees)),
        float(np.sqrt(within / np.median(pieces.weight))),
    )


def split_that_predicts(
    fit: MeasuredFit, rows: Rows, candidates: Mapping[str, pd.Series]
) -> str | None:
    """The column whose groups predict the levels of pieces that are left out best, if any does.

    A piece is predicted by the others of its group, and without groups by all others.
    """
    gains = {}
    for name, labels in candidates.items():
        codes = pd.factorize(labels)[0]
        pieces = pieces_of(fit, rows, codes)
        if np.bincount(pieces.group).min() < 2:
            continue
        size = np.bincount(pieces.group, pieces.weight)
        mean, *_ = analysed(pieces.level, pieces.weight, pieces.group)
        own, whole = size[pieces.group], float(size.sum())
        others = (own * mean[pieces.group] - pieces.weight * pieces.level) / (own - pieces.weight)
        every = (float(size @ mean) - pieces.weight * pieces.level) / (whole - pieces.weight)
        gain = pieces.weight * ((pieces.level - every) ** 2 - (pieces.level - others) ** 2)
        if gain.sum() > 2 * np.sqrt(gain.size) * gain.std():
            gains[name] = float(gain.sum() / np.sum(pieces.weight * (pieces.level - every) ** 2))
    return max(gains, key=lambda name: gains[name]) if gains else None
