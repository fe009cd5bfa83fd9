"""How well the fit to all other rows predicts those of a part."""

import numpy as np
from jaxtyping import Float

from adhesion_jax.inference.rows import Rows
from adhesion_jax.inference.sums import Sums, Variance

#: Parts that are left out to judge a curve, where there are fewer runs.
_PARTS = 12


def left_out(
    found: Sums,
    rows: Rows,
    variance: Variance,
    free: np.ndarray,
    penalty: np.ndarray,
) -> Float[np.ndarray, " parts"]:
    """The log density of each part, given the fit to all others: runs, or a twelfth of a log."""
    parts = rows.cluster
    if rows.clusters < 2:
        parts = np.arange(parts.size) * _PARTS // parts.size
    elif not (rows.ordered or rows.several):  # points in no order: every twelfth
        parts = np.argsort(np.argsort(rows.slip[rows.blocks[:-1]], kind="stable")) % _PARTS
    count, used = int(parts.max()) + 1, np.flatnonzero(free)
    matrix = np.zeros((count, used.size, used.size))
    score, own = np.zeros((count, used.size)), np.zeros(count)
    np.add.at(matrix, parts, found.matrix[:, used[:, None], used])
    np.add.at(score, parts, found.score[:, used])
    spread = np.add.reduceat(np.log(variance.row()), rows.blocks[:-1])
    np.add.at(own, parts, found.squares + spread)
    others = matrix.sum(axis=0) + np.diag(penalty[used]) - matrix
    scale = 1 / np.sqrt(np.maximum(np.diagonal(others, axis1=1, axis2=2), 1e-300))
    even = others * scale[:, :, None] * scale[:, None, :] + 1e-10 * np.eye(used.size)
    step = -scale * np.linalg.solve(even, (scale * score)[:, :, None])[:, :, 0]
    bend = np.einsum("pi,pij,pj->p", step, matrix, step)
    return -0.5 * (own - 2 * np.sum(step * score, axis=1) + bend)
