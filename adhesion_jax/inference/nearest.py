"""The curve without a departure that is nearest to a law."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from adhesion_jax.inference.descent import Problem, descended
from adhesion_jax.inference.law import FittedLaw
from adhesion_jax.inference.posing import chosen_of, from_start
from adhesion_jax.inference.rows import Rows, thinned
from adhesion_jax.inference.sums import Variance

#: Most rows that tell where the points are.
_ROWS = 20_000

#: Slips at which a law is compared with the nearest curve; and the search of that ends where a step
#: promises to lower half the sum of squares, over the mean square, by less than this.
_COMPARED, _NEAR = 200, 1e-10


class Nearest(NamedTuple):
    """The curve without a departure that is nearest to a law."""

    parameters: Float[np.ndarray, " free"]
    by_law: Float[np.ndarray, "free all"]
    misfit: float
    on_bound: Bool[np.ndarray, " free"]


def nearest_to(
    problem: Problem,
    starts: Sequence[np.ndarray],
    law: FittedLaw,
    free: Bool[np.ndarray, " free"],
    rows: Rows,
    variance: Variance,
) -> Nearest:
    """By least squares from the best of some starts, at slips that share out the rows' weight."""
    some = thinned(rows, _ROWS)
    size = np.abs(some.slip)
    order = np.argsort(size, kind="stable")
    weight = np.cumsum(1 / chosen_of(variance.relative, size.size)[order])
    shares = (np.arange(_COMPARED) + 0.5) / _COMPARED
    slip = size[order[np.searchsorted(weight, shares * weight[-1])]]
    of_law = law.at(slip)
    conditions = {name: np.full(_COMPARED, value) for name, value in law.conditions.items()}
    one, whole = np.ones(_COMPARED), np.array([0, _COMPARED])
    few = Rows(slip, of_law.adhesion, conditions, one, whole, whole, np.zeros(1, int), False, False)
    height = max(float(np.sqrt(np.mean(of_law.adhesion**2))), 1e-300)
    even = Variance(height, one, 0 * one)
    found = []
    for start in starts:
        share, _ = descended(problem, from_start(start), few, even, robust=False, near=_NEAR)
        alone = law._replace(parameters=problem.parameters(share)).at(slip)
        missed = float(np.sqrt(np.mean((of_law.adhesion - alone.adhesion) ** 2))) / height
        found.append((missed, share, alone))
    missed, share, alone = min(found, key=lambda one: one[0])
    stretch = problem.stretch(share)
    share = share[: problem.free]
    bound = free & ((share <= 0) | (share >= 1))
    used = np.flatnonzero(free & ~bound)
    by_law = np.zeros((problem.free, stretch.size))
    own = alone.by_parameter[:, used] * stretch[used]
    by_law[used] = np.linalg.lstsq(own, of_law.by_parameter, rcond=_NEAR)[0]
    by_law[used] *= stretch[used, None]
    return Nearest(problem.parameters(from_start(share))[: problem.free], by_law, missed, bound)
