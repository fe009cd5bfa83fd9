"""Sums over the rows of blocks: what a fit and its covariance need, whatever the number of rows."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from adhesion_jax.curves import Curve
from adhesion_jax.inference.rows import Rows
from adhesion_jax.inference.values import Span, expected_values

#: Rows whose columns are held at a time.
_CHUNK = 65536

#: Residuals beyond this multiple of their standard deviation pull at a fit no more than one there
#: (Huber 1964, Ann. Math. Statist. 35:73-101): of normal noise a fit loses 1 % of efficiency.
TUNING = 2.0


class Variance(NamedTuple):
    """The variance of a row's residual: sigma^2 over its design weight + (slope x spread)^2.

    The slope of the curve is that of a fit before: with its own slope a curve could widen its own
    noise (Carroll and Ruppert 1988, chapter 3).
    """

    sigma: float
    row: Float[np.ndarray, " rows"]  # the whole of it
    spread: Float[np.ndarray, " rows"]  # of the slip: what blunts the mean


class Sums(NamedTuple):
    """Of residuals z in standard deviations and derivatives x, over the rows of each block.

    psi is Huber's function of z, which is z within the tuning constant.
    """

    loss: Float[np.ndarray, " blocks"]  # sum rho(z)
    score: Float[np.ndarray, "blocks all"]  # sum x psi(z)
    matrix: Float[np.ndarray, "blocks all all"]  # sum x x' psi'(z), or x x' psi(z)/z in a search
    squares: Float[np.ndarray, " blocks"]  # sum z^2 psi(z)/z
    plain: float  # sum of squares of the residuals themselves


def sums(
    rows: Rows,
    curve: Curve,
    parameters: Float[np.ndarray, " all"],
    stretch: Float[np.ndarray, " all"],
    span: Span,
    variance: Variance,
    robust: bool,
    searching: bool,
) -> Sums:
    """The sums at these parameters, in chunks; `stretch` are derivatives by a fit's coordinates.

    While a fit is `searching`, all rows make one block.
    """
    edges = np.array([0, rows.slip.size]) if searching else rows.blocks
    count, width = edges.size - 1, stretch.size
    loss, squares, plain = np.zeros(count), np.zeros(count), 0.0
    score, matrix = np.zeros((count, width)), np.zeros((count, width, width))
    for first in range(0, rows.slip.size, _CHUNK):
        last = min(first + _CHUNK, rows.slip.size)
        some = slice(first, last)
        needed = {name: rows.conditions[name][some] for name in curve.NEEDS}
        found = expected_values(
            curve, parameters, span, rows.slip[some], variance.spread[some], needed
        )
        scale = 1 / np.sqrt(variance.row[some])
        residual = rows.adhesion[some] - found.adhesion
        z = residual * scale
        size = np.abs(z)
        pull = np.minimum(1.0, TUNING / np.maximum(size, 1e-300)) if robust else np.ones(z.size)
        x = found.by_parameter * (stretch * scale[:, None])
        weight = pull if searching else (pull >= 1).astype(float)
        weighed = x * weight[:, None]
        rho = np.where(pull < 1, TUNING * (size - 0.5 * TUNING), 0.5 * z**2)
        plain += float(residual @ residual)
        begin = int(np.searchsorted(edges, first, side="right")) - 1
        for block in range(begin, int(np.searchsorted(edges, last, side="left"))):
            here = slice(max(edges[block] - first, 0), min(edges[block + 1] - first, last - first))
            loss[block] += rho[here].sum()
            squares[block] += np.sum(z[here] ** 2 * pull[here])
            score[block] += x[here].T @ (z[here] * pull[here])
            matrix[block] += x[here].T @ weighed[here]
    return Sums(loss, score, matrix, squares, plain)


def residuals(
    rows: Rows,
    curve: Curve,
    parameters: Float[np.ndarray, " all"],
    span: Span,
    spread: Float[np.ndarray, " rows"],
) -> tuple[Float[np.ndarray, " rows"], Float[np.ndarray, " rows"], Float[np.ndarray, " rows"]]:
    """Residuals of adhesion, the slope of the curve there, and the curve itself."""
    left, slope, mean = (np.empty(rows.slip.size) for _ in range(3))
    for first in range(0, rows.slip.size, _CHUNK):
        some = slice(first, first + _CHUNK)
        needed = {name: rows.conditions[name][some] for name in curve.NEEDS}
        found = expected_values(curve, parameters, span, rows.slip[some], spread[some], needed)
        left[some] = rows.adhesion[some] - found.adhesion
        mean[some], slope[some] = found.adhesion, found.by_slip
    return left, slope, mean
