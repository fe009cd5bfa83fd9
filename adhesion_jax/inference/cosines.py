"""Variances from the slowest cosines of a score: they hold whatever the memory of the noise."""

from functools import reduce
from math import factorial
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

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
