"""How large the departure of a curve from the points is, beyond what noise makes."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from adhesion_jax.curves.bent import FUNCTIONS
from adhesion_jax.inference.sandwich import COSINES, grouped
from adhesion_jax.inference.sums import Sums
from adhesion_jax.linear_algebra import eigh

#: Standard deviations of the factors, relative to the first: a curve without corners.
_SMOOTH = (2 * np.arange(FUNCTIONS) + 1.0) ** -1.5

#: Sizes of the first factor that are considered.
_SIZES = np.geomspace(1e-3, 1.0, 61)

#: The size of the departure under which the noise of its functions is judged.
_LOOSE = 1.0

#: Fewest clusters whose scatter tells the noise of the functions; fewer are cut into cosines.
_FEWEST_CLUSTERS = 6


class Departure(NamedTuple):
    """The prior of the factors, as a penalty on a sum in standard deviations."""

    size: float  # standard deviation of the first factor
    penalty: Float[np.ndarray, " functions"]
    inflation: float  # variance of the functions' score over that of independent rows
    occam: float  # what the freedom of the departure costs: half the log of its narrowing
    degrees: float  # of freedom that the departure takes from the residual


def departure_of(
    found: Sums,
    factors: Float[np.ndarray, " functions"],
    free: Bool[np.ndarray, " all"],
    cluster: Int[np.ndarray, " blocks"],
    ordered: bool,
) -> Departure:
    """The size by the likelihood of the functions' score, under noise as large as it is seen.

    With the free parameters of the curve projected out, the score z of the factors b is normal of
    mean S b, S their information, and of covariance c S: c is judged from the scatter of z between
    clusters or, of a single log, from its slow cosines, so that slow noise is not taken for a
    departure where slip passes the same values several times; of a single sweep the two cannot be
    told apart. The sums are those at the least penalised sum for these factors. The size is the
    likeliest.
    """
    count = free.size - FUNCTIONS
    used, last = np.flatnonzero(free[:count]), np.arange(count, free.size)

    def alone(total: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        own = total[used[:, None], used] + 1e-12 * np.diag(np.diagonal(total)[used])
        lean = np.linalg.lstsq(own, total[used[:, None], last], rcond=1e-12)[0]
        return lean, total[last[:, None], last] - total[last[:, None], used] @ lean

    lean, information = alone(found.matrix.sum(axis=0))
    even = information * _SMOOTH[:, None] * _SMOOTH
    projected = np.zeros((free.size, FUNCTIONS))
    projected[used], projected[last] = -lean * _SMOOTH, np.diag(_SMOOTH)
    score = found.score @ projected  # [blocks, functions]
    whole = score.sum(axis=0) + information @ factors * _SMOOTH

    # Outliers have a score but no information: the step to a loose fit is that of a minimum.
    lean, pulled = alone(found.pulled)
    towards = score.sum(axis=0) - factors / (_SMOOTH * _LOOSE**2)
    bound = pulled * _SMOOTH[:, None] * _SMOOTH + np.eye(FUNCTIONS) / _LOOSE**2
    step = np.zeros(free.size)
    step[last] = np.linalg.solve(bound, towards) * _SMOOTH
    step[used] = -lean @ step[last]
    left = score - (found.matrix @ step) @ projected
    inflation = max(_scatter(left, cluster, ordered) / max(np.trace(even), 1e-300), 1.0)

    values, vectors = eigh(even)
    values = np.maximum(values, 0.0)
    square = (vectors.T @ whole) ** 2
    # Less the log likelihood of no departure: so a direction of which nothing is known has no part.
    gained = _SIZES[:, None] ** 2 * values / inflation
    freed = _SIZES[:, None] ** 2 * square / inflation**2
    told = 0.5 * np.sum(freed / (1 + gained) - np.log1p(gained), axis=1)
    size = float(_SIZES[told.argmax()])
    occam = 0.5 * float(np.sum(np.log1p(size**2 * values / inflation)))
    told_by_rows = size**2 * values / (inflation + size**2 * values)
    penalty = inflation / (size * _SMOOTH) ** 2
    return Departure(size, penalty, inflation, occam, float(told_by_rows.sum()))


def _scatter(left: np.ndarray, cluster: np.ndarray, ordered: bool) -> float:
    """The sum over the functions of the variance of their score."""
    clusters = int(cluster[-1]) + 1
    if clusters >= _FEWEST_CLUSTERS or not ordered:
        return float(np.sum(grouped(left, cluster) ** 2)) * clusters / max(clusters - 1, 1)
    time = (np.arange(len(left)) + 0.5) / len(left)
    cosine = np.sqrt(2) * np.cos(np.pi * np.arange(1, COSINES + 1)[:, None] * time)
    return float(np.sum((cosine @ left) ** 2)) / COSINES
