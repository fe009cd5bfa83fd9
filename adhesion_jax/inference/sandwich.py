"""Standard errors that hold whatever the noise depends on, by runs as clusters and by cosines."""

from functools import reduce
from math import factorial
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from adhesion_jax.inference.sums import Sums
from adhesion_jax.linear_algebra import eigh

#: Number of cosines, slower than which noise is not told from the curve.
COSINES = 4

#: Directions of which cosines are taken together: their products with all blocks are in memory.
_AT_A_TIME = 50


#: The series of sin(x) / x in x^2, the highest power first: for x up to 2 to the last digit.
_SERIES = [(-1) ** k / factorial(2 * k + 1) for k in reversed(range(13))]


class Blocks(NamedTuple):
    """Of each block in its order, in coordinates in which the inverse information is the identity.

    The arrays are those of NumPy, or of jax.
    """

    score: Float[np.ndarray, "blocks all"]
    matrix: Float[np.ndarray, "blocks all all"]


def by_cosines(found: Blocks, along: Float[np.ndarray, "n all"]) -> Float[np.ndarray, " n"]:
    """Variances from the COSINES slowest cosines of the score over information time."""
    variance = np.empty(len(along))
    for first in range(0, len(along), _AT_A_TIME):
        some = along[first : first + _AT_A_TIME]
        told = np.moveaxis(some @ found.matrix, 2, 0)
        share = np.sum(told * some.T[:, None], axis=0)
        variance[first : first + _AT_A_TIME] = of_cosines(found.score @ some.T, told, share)
    return variance


def of_cosines(pull: Any, told: Any, share: Any) -> Any:
    """The same for directions a [n], from what each block tells of them; all axes may be more.

    Time is the share of the information about the quantity that has come so far, so that the
    cosines have no part in common with the estimate. Each square is divided by its expectation for
    independent rows. Degrees of freedom are the cosines (Mueller 2004; Lazarus, Lewis, Stock and
    Watson 2018, J. Bus. Econ. Stat. 36:541-559).

    Args:
        pull: the score along a, [blocks, n, ...], of NumPy or of jax.
        told: the product of the block's matrix and a, [all, blocks, n, ...].
        share: that of it and a, the information, [blocks, n, ...].
    """
    xp = share.__array_namespace__()
    whole = xp.maximum(share.sum(axis=0), 1e-300)
    slow = _sine(xp.pi * (0.5 - (xp.cumsum(share, axis=0) - 0.5 * share) / whole))
    before, cosine, squares = 1.0, slow, 0.0
    for _ in range(COSINES):
        amount = xp.sum(cosine * pull, axis=0)
        lean = xp.sum(cosine * told, axis=1)
        expected = xp.sum(cosine**2 * share, axis=0) - xp.sum(lean**2, axis=0)
        squares = squares + amount**2 / xp.maximum(expected, 0.5e-3 * whole)
        before, cosine = cosine, 2 * slow * cosine - before  # of the next multiple of the angle
    return whole * squares / COSINES


def _sine(angle: Any) -> Any:
    """The sine of an angle between two right angles.

    The compiler of jax takes each sine of 64 bits by itself, not many side by side: with the series
    `cosine_errors` takes two thirds of the time.
    """
    square = angle * angle
    return angle * reduce(lambda sum_, term: sum_ * square + term, _SERIES)


#: Fewest degrees of freedom with which runs as clusters count: with fewer runs cosines alone do.
_FEWEST_DEGREES = 4.0

#: Degrees of freedom of the size of the departure, which its functions tell.
_OF_PRIOR = 8.0

#: Largest leverage of a cluster: one alone that determines a direction has no residual there.
_MOST_LEVERAGE = 1 - 1e-6


class Clusters(NamedTuple):
    """Of each cluster, in coordinates in which the inverse of the information is the identity."""

    score: Float[np.ndarray, "clusters all"]  # adjusted for leverage
    across: Float[np.ndarray, "clusters all all"]  # leverage/sqrt(1 - leverage), as matrices
    own: Float[np.ndarray, "clusters all all"]  # leverage/(1 - leverage)


class Sandwich(NamedTuple):
    """The covariance of parameters whose fit minimises a sum over rows and a penalty.

    V = B (M + c P) B, B = (H + P)^-1 of the information H and the penalty P, M the covariance of
    the score, by clusters or by cosines, and c the variance of the score of a smooth function over
    that of independent rows: c P is what the penalty, as the prior of the departure, is uncertain
    by.
    """

    root: Float[np.ndarray, "all all"]  # L of B = L L', zero where a parameter is held
    prior: Float[np.ndarray, "all all"]  # c L' P L
    clusters: Clusters | None
    blocks: Blocks | None  # None where rows have no order

    def errors(
        self, directions: Float[np.ndarray, "n all"]
    ) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """Standard errors of linear functions of the parameters, and their degrees of freedom.

        The larger of both variances, with its own degrees of freedom; in quadrature that of the
        prior (Satterthwaite 1946, Biometrics Bull. 2:110-114).
        """
        along = directions @ self.root
        variance, degrees = np.zeros(len(along)), np.ones(len(along))
        if self.clusters is not None:
            variance, degrees = by_clusters(self.clusters, along)
            if self.blocks is not None:
                variance = np.where(degrees < _FEWEST_DEGREES, 0.0, variance)
        if self.blocks is not None:
            slow = by_cosines(self.blocks, along)
            larger = slow > variance
            variance = np.where(larger, slow, variance)
            degrees = np.where(larger, float(COSINES), degrees)
        of_prior = np.einsum("ni,ij,nj->n", along, self.prior, along)
        whole = np.maximum(variance + of_prior, 1e-300)
        known = (variance / whole) ** 2 / degrees + (of_prior / whole) ** 2 / _OF_PRIOR
        degrees = 1 / np.maximum(known, 1e-6)
        return np.sqrt(whole), degrees


def sandwich(
    found: Sums,
    cluster: Int[np.ndarray, " blocks"],
    free: Bool[np.ndarray, " all"],
    penalty: Float[np.ndarray, " all"],
    inflation: float,
    ordered: bool,
) -> Sandwich:
    """The sandwich at a minimum. Rows of no known order are independent by clusters alone."""
    width = free.size
    information = found.matrix.sum(axis=0) + np.diag(penalty)
    used = np.flatnonzero(free)
    root = np.zeros((width, width))
    own = information[used[:, None], used]
    scale = 1 / np.sqrt(np.maximum(np.diagonal(own), 1e-300))
    values, vectors = eigh(own * scale[:, None] * scale)
    factors = 1 / np.sqrt(np.maximum(values, 1e-12))
    root[used[:, None], np.arange(used.size)] = vectors * scale[:, None] * factors
    matrix = root.T @ found.matrix @ root
    score = found.score @ root
    prior = inflation * (root.T * penalty) @ root
    several = cluster[-1] > 0
    clusters = _clusters(grouped(matrix, cluster), grouped(score, cluster)) if several else None
    return Sandwich(root, prior, clusters, Blocks(score, matrix) if ordered else None)


def grouped(of_blocks: np.ndarray, cluster: Int[np.ndarray, " blocks"]) -> np.ndarray:
    """The sums over the blocks of each cluster, which follow upon each other."""
    return np.add.reduceat(of_blocks, np.searchsorted(cluster, np.arange(cluster[-1] + 1)))


def _clusters(matrix: np.ndarray, score: np.ndarray) -> Clusters:
    """The correction CR2: with (I - leverage)^-1/2 the score is unbiased if rows are independent.

    Bell and McCaffrey 2002, Survey Methodology 28:169-181; Pustejovsky and Tipton 2018, J. Bus.
    Econ. Stat. 36:672-683.
    """
    leverage, vectors = eigh(matrix)
    leverage = np.clip(leverage, 0.0, _MOST_LEVERAGE)

    def with_values(values: np.ndarray) -> np.ndarray:
        return (vectors * values[:, None, :]) @ vectors.mT

    adjusted = (with_values((1 - leverage) ** -0.5) @ score[:, :, None])[:, :, 0]
    return Clusters(
        adjusted,
        with_values(leverage / np.sqrt(1 - leverage)),
        with_values(leverage / (1 - leverage)),
    )


def by_clusters(
    found: Clusters, along: Float[np.ndarray, "n all"]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Variances, and degrees of freedom as if rows were independent.

    (sum of the eigenvalues)^2 / sum of their squares, of the matrix of the quadratic form that the
    estimate is (Bell and McCaffrey 2002, Eq. 12).
    """
    variance = np.sum((along @ found.score.T) ** 2, axis=1)
    # Of the form diag(own) - across across', [clusters, clusters], trace and sum of squares.
    across = np.einsum("cij,nj->nci", found.across, along)
    own = np.einsum("cij,ni,nj->nc", found.own, along, along, optimize=True)
    size = np.sum(across**2, axis=2)
    squares = np.sum(own**2 - 2 * own * size, axis=1)
    squares += np.sum((across.mT @ across) ** 2, axis=(1, 2))
    degrees = np.sum(own - size, axis=1) ** 2 / np.maximum(squares, 1e-300)
    return variance, np.maximum(degrees, 1.0)
