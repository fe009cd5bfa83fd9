"""Sums over the rows of blocks: what a fit and its covariance need, whatever the number of rows."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from adhesion_jax.inference.law import AT_A_TIME, FittedLaw, Values
from adhesion_jax.inference.rows import Rows

#: Most blocks of a chunk that are multiplied one by one; of more, all rows and then sums of them.
_ONE_BY_ONE = 16

#: Residuals beyond this multiple of their standard deviation pull at a fit no more than one there
#: (Huber 1964, Ann. Math. Statist. 35:73-101): of normal noise a fit loses 1 % of efficiency.
TUNING = 2.0


class Variance(NamedTuple):
    """The variance of a row's residual: sigma^2 over its design weight + (slope x spread)^2.

    The slope of the curve is that of a fit before: with its own slope a curve could widen its own
    noise (Carroll and Ruppert 1988, chapter 3).
    """

    sigma: float
    relative: Float[np.ndarray, " rows"]  # the whole of it over sigma^2
    spread: Float[np.ndarray, " rows"]  # of the slip: what blunts the mean

    def row(self, some: slice = slice(None)) -> Float[np.ndarray, " some"]:
        """The whole of it, of some rows."""
        return self.sigma**2 * self.relative[some]


class Sums(NamedTuple):
    """Of residuals z in standard deviations and derivatives x, over the rows of each block.

    psi is Huber's function of z, which is z within the tuning constant.
    """

    loss: Float[np.ndarray, " blocks"]  # sum rho(z)
    score: Float[np.ndarray, "blocks all"]  # sum x psi(z)
    matrix: Float[np.ndarray, "blocks all all"]  # sum x x' psi'(z)
    squares: Float[np.ndarray, " blocks"]  # sum z^2 psi(z)/z
    residual: Float[np.ndarray, " rows"]  # of adhesion
    pulled: Float[np.ndarray, "all all"]  # sum x x' psi(z)/z over all rows: to search a minimum


def pull(z: Float[np.ndarray, " rows"]) -> Float[np.ndarray, " rows"]:
    """psi(z)/z, the weight of each row in iterated least squares."""
    return np.minimum(1.0, TUNING / np.maximum(np.abs(z), 1e-300))


def huber(z: Float[np.ndarray, " rows"]) -> Float[np.ndarray, " rows"]:
    """rho(z), for z in size."""
    return np.where(z < TUNING, 0.5 * z**2, TUNING * (z - 0.5 * TUNING))


def sums(
    rows: Rows,
    law: FittedLaw,
    stretch: Float[np.ndarray, " all"],
    variance: Variance,
    robust: bool,
    blocks: Int[np.ndarray, " edges"],
) -> Sums:
    """The sums about this law, in chunks; `stretch` are derivatives by a fit's coordinates.

    `blocks` are their first rows, and the number of rows.
    """
    count, width = blocks.size - 1, stretch.size
    whole = Sums(
        np.zeros(count),
        np.zeros((count, width)),
        np.zeros((count, width, width)),
        np.zeros(count),
        np.empty(rows.slip.size),
        np.zeros((width, width)),
    )
    for some, found in _in_chunks(rows, law, variance.spread, AT_A_TIME):
        scale = 1 / np.sqrt(variance.row(some))
        whole.residual[some] = rows.adhesion[some] - found.adhesion
        z = whole.residual[some] * scale
        pulls = pull(z) if robust else np.ones(z.size)
        within = pulls >= 1
        x = found.by_parameter.T * scale
        x *= stretch[:, None]
        first = int(np.searchsorted(blocks, some.start, side="right")) - 1
        here = np.arange(first, int(np.searchsorted(blocks, some.stop, side="left")))
        here = here[blocks[here + 1] > blocks[here]]
        begins = np.maximum(blocks[here] - some.start, 0)
        rho = huber(np.abs(z)) if robust else 0.5 * z**2
        of_rows = np.concatenate([[rho, z**2 * pulls], x * (z * pulls)])
        added = np.add.reduceat(of_rows, begins, axis=1)
        matrix = _products(x, x * within, begins)
        whole.loss[here] += added[0]
        whole.squares[here] += added[1]
        whole.score[here] += added[2:].T
        whole.matrix[here] += matrix
        whole.pulled[...] += matrix.sum(axis=0) if within.all() else (x * pulls) @ x.T
    return whole


def _products(
    x: Float[np.ndarray, "all rows"],
    weighed: Float[np.ndarray, "all rows"],
    begins: Int[np.ndarray, " blocks"],
) -> Float[np.ndarray, "blocks all all"]:
    """The sums of x x' over the rows of each block."""
    if begins.size <= _ONE_BY_ONE:
        parts = (np.split(columns, begins[1:], axis=1) for columns in (weighed, x))
        return np.stack([a @ b.T for a, b in zip(*parts, strict=True)])
    found = np.empty((begins.size, len(x), len(x)))
    for i in range(len(x)):
        of_column = np.add.reduceat(weighed[i] * x[: i + 1], begins, axis=1)
        found[:, i, : i + 1] = of_column.T
        found[:, : i + 1, i] = of_column.T
    return found


def law_at(
    rows: Rows, law: FittedLaw, spread: Float[np.ndarray, " rows"], *of: str
) -> list[Float[np.ndarray, " rows"]]:
    """Adhesion at every row, and whatever else of `Values` is named that is one number a row."""
    found = [np.empty(rows.slip.size) for _ in range(1 + len(of))]
    for some, values in _in_chunks(rows, law, spread, 3 * AT_A_TIME):
        for column, name in zip(found, ("adhesion", *of), strict=True):
            column[some] = getattr(values, name)
    return found


def _in_chunks(
    rows: Rows, law: FittedLaw, spread: Float[np.ndarray, " rows"], size: int
) -> Iterator[tuple[slice, Values]]:
    """Chunks of rows in their order, and the values there."""
    for first in range(0, rows.slip.size, size):
        some = slice(first, min(first + size, rows.slip.size))
        needed = {name: rows.conditions[name][some] for name in law.curve.NEEDS}
        yield some, law.at(rows.slip[some], spread[some], needed)
