"""The slip that is to be expected where one was measured with noise."""

import numpy as np
from jaxtyping import Float
from scipy.special import ndtr

from adhesion_jax.inference.grouping import evenly

#: Rows by which the density of the true slips is found, most cells of it, and steps of the search.
_ROWS, _CELLS, _STEPS = 6000, 32, 100

#: Least width of a cell in standard deviations of the noise: finer ones are not told apart.
_WIDTH = 0.5

#: Places about the edge of each cell at which expectations are tabled, in standard deviations, and
#: sizes of the noise for which they are.
_PLACES, _LEVELS = np.linspace(-4.5, 4.5, 13), 24


def expected_slip(
    slip: Float[np.ndarray, " rows"], spread: Float[np.ndarray, " rows"]
) -> tuple[Float[np.ndarray, " rows"], Float[np.ndarray, " rows"]]:
    """Mean and standard deviation of the true slip of each row, given the measured one.

    Measured slip is the true one and normal noise of standard deviation `spread`. Most rows at the
    edge of a crowd, as rolling makes one about slip 0, belong to it; where slips are spread evenly
    the expected slip is the measured one. The density of the true slips is constant in each of some
    cells, and is the likeliest that a few steps of expectation and maximisation from the density of
    the measured ones lead to (Laird 1978, J. Am. Stat. Assoc. 73:805-811; regression calibration:
    Carroll, Ruppert, Stefanski and Crainiceanu 2006, Measurement Error in Nonlinear Models,
    chapter 4).
    """
    if not spread.any():
        return slip, spread
    chosen = evenly(slip.size, _ROWS)
    edges, density = _density(slip[chosen], spread[chosen])
    levels = np.geomspace(spread.min(), spread.max(), _LEVELS if np.ptp(spread) else 1)
    level = np.searchsorted(np.sqrt(levels[1:] * levels[:-1]), spread)
    mean, scatter = np.array(slip), np.array(spread)
    for i, sd in enumerate(levels):
        rows = level == i
        if not rows.any():
            continue
        places = np.unique(edges[:, None] + sd * _PLACES)
        shift, narrowing = _moments(places, np.full(places.size, sd), edges, density)
        mean[rows] += spread[rows] * np.interp(slip[rows], places, shift)
        scatter[rows] *= np.interp(slip[rows], places, narrowing)
    return mean, scatter


def _density(
    slip: Float[np.ndarray, " some"], spread: Float[np.ndarray, " some"]
) -> tuple[Float[np.ndarray, " edges"], Float[np.ndarray, " cells"]]:
    """Edges of the cells, and the density of the true slips in each."""
    width = _WIDTH * float(np.quantile(spread, 0.25))
    quantiles = np.quantile(slip, np.linspace(0.0, 1.0, _CELLS + 1))
    edges = np.unique(np.round(quantiles / width))
    edges = width * np.concatenate([[edges[0] - 1], edges, [edges[-1] + 1]])
    below = ndtr((edges - slip[:, None]) / spread[:, None])
    likelihood = np.diff(below, axis=1) / np.diff(edges)
    share = np.diff(edges) * likelihood.mean(axis=0)
    for _ in range(_STEPS):
        share = share * np.mean(likelihood / (likelihood @ share)[:, None], axis=0)
    return edges, share / np.diff(edges)


def _moments(
    slip: Float[np.ndarray, " places"],
    spread: Float[np.ndarray, " places"],
    edges: Float[np.ndarray, " edges"],
    density: Float[np.ndarray, " cells"],
) -> tuple[Float[np.ndarray, " places"], Float[np.ndarray, " places"]]:
    """Mean of the true slip less the measured one, and its deviation, both over the noise's."""
    z = (edges - slip[:, None]) / spread[:, None]
    normal = np.exp(-0.5 * z**2) / np.sqrt(2 * np.pi)
    whole = np.maximum(np.diff(ndtr(z), axis=1) @ density, 1e-300)
    shift = -(np.diff(normal, axis=1) @ density) / whole
    square = 1 - (np.diff(z * normal, axis=1) @ density) / whole
    return shift, np.sqrt(np.maximum(square - shift**2, 0.0))
