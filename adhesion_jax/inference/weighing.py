"""What the rows of a noisy slip count for, whichever curve is fitted to them."""

from collections.abc import Iterable

import numpy as np
from jaxtyping import Float
from scipy.special import ndtr

from adhesion_jax.curves import Curve
from adhesion_jax.inference.descent import (
    STRAIGHT,
    Problem,
    chosen_of,
    descended,
    from_start,
    posed,
)
from adhesion_jax.inference.noise import SlipNoise
from adhesion_jax.inference.rows import Rows, evenly, thinned
from adhesion_jax.inference.sums import Variance, huber, law_at

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


#: A residual below this share of the adhesion is due to the rounding of numbers, not to noise.
EXACT = 1e-10

#: Rounds of fit and of how much of the slip's noise acts, and the most rows of these; the shares of
#: the noise that are considered, and then such about the likeliest, nearer by half in each round;
#: and the values of sigma over the root mean square of the residual.
_WEIGHINGS, _WEIGHED_ROWS = 3, 5000
_ACTIVE, _NEARER = (0.0, 0.25, 0.5, 0.75, 1.0), np.array([-0.125, 0.0, 0.125])
_SIGMAS = np.geomspace(1e-3, 1.0, 60)


def alike(rows: Rows) -> Variance:
    """The variance of rows whose slip is exact, in any unit."""
    return Variance(1.0, 1 / rows.design, np.broadcast_to(0.0, rows.slip.shape))


def weighed(
    curve: Curve,
    start: Float[np.ndarray, " free"],
    rows: Rows,
    slip: SlipNoise,
    slip_is_velocity: bool,
) -> tuple[Rows, SlipNoise, Variance]:
    """Rows at the slips that are to be expected, the noise of slip that acts, and the variances.

    By the slope of one curve without a departure. They are the same for all curves that are fitted:
    with a slope of its own a curve could widen its own noise (Carroll and Ruppert 1988, chapter 3).
    """
    problem, _ = posed(curve, start, rows, slip_is_velocity)
    some = thinned(rows, _WEIGHED_ROWS)
    spread = chosen_of(slip.spread, some.slip.size)
    share, active = from_start(start), 1.0
    actives = (1.0,) if slip.given else _ACTIVE
    for turn in range(_WEIGHINGS):
        there, active, variance = _weighing(problem, share, some, spread, actives)
        share, _ = descended(problem, share, there, variance, STRAIGHT, turn > 0)
        if not slip.given:
            actives = np.clip(active + _NEARER / 2**turn, 0.0, 1.0)
    there, _, variance = _weighing(problem, share, rows, slip.spread, (active,))
    return there, slip._replace(sigma=active * slip.sigma, spread=active * slip.spread), variance


def _weighing(
    problem: Problem,
    share: np.ndarray,
    rows: Rows,
    spread: Float[np.ndarray, " rows"],
    actives: Iterable[float],
) -> tuple[Rows, float, Variance]:
    """Rows at the slips that are to be expected, how much of the slip's noise acts, and variances.

    These are sigma^2 over the design weight + (slope x standard deviation of the true slip)^2. Of
    the noise of standard deviation `spread` the share acts, among these, and sigma is such, as is
    likeliest for the residual, by Huber's function.
    """
    floor = EXACT**2 * float(np.mean(rows.adhesion**2))
    best = -np.inf
    for active in actives:
        mean, scatter = expected_slip(rows.slip, active * spread)
        there = rows._replace(slip=mean)
        law, slope = law_at(there, problem.law(share), scatter, "by_slip")
        left, felt = rows.adhesion - law, (slope * scatter) ** 2
        few = evenly(left.size, _WEIGHED_ROWS)
        for square in max(float(np.mean(left**2)), floor) * _SIGMAS**2:
            row = square / rows.design[few] + felt[few]
            z = np.abs(left[few]) / np.sqrt(row)
            told = -float(np.sum(0.5 * np.log(row) + huber(z)))
            if told > best:
                relative = 1 / rows.design + felt / square
                variance = Variance(float(np.sqrt(square)), relative, scatter)
                best, found = told, (there, active, variance)
    return found
