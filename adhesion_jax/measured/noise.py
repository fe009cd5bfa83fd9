"""The noise of measured runs, estimated together with a curve by restricted maximum likelihood.

The adhesion of a run, y, [points], is taken as

    y = f(s; theta) + sum_j b_j phi_j(s) + f(s) a + e,

with the curve f, what the curve misses as a smooth function of the slip (b_j normal of variance
misfit^2/j^3), a level of the run (a normal, of standard deviation run_scatter) and noise e of
standard deviation sigma, whose neighbours in a run have the correlation `autocorrelation`.

With the curve linear in theta about its fit, the likelihood needs no more than sums of products of
columns over the points of each run: of the derivatives, of phi, of f, and of the residual.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

#: Number of functions of the slip that make up what a curve misses.
MISFITS = 8

#: Inverse variances of their factors, relative to that of the first.
_ROUGHNESS = np.arange(1.0, MISFITS + 1) ** 3

#: Largest autocorrelation that is considered: noise beyond it would be a drift.
_MOST_CORRELATED = 0.995

#: The autocorrelation is estimated only if runs have more points than this on average: in shorter
#: runs it cannot be separated from their levels. By hand.
_SHORT = 5

#: Largest variance of the levels of the runs, and of the misfit, relative to that of the noise.
_LARGEST_RATIO = 1e8

#: Places along autocorrelation and run scatter, and along the misfit: of a first grid, and of finer
#: ones about the best place so far, each spanning half the one before.
_FIRST, _FIRST_MISFIT, _FINER, _TURNS = 9, 33, 5, 8

#: Share of the information about a parameter that is added to it against rounding.
ROUNDING = 1e-12

#: Largest number of values that are held for a grid.
_HELD = 4_000_000


class RunNoise(NamedTuple):
    """The noise: a standard deviation, a correlation, and variances relative to sigma^2."""

    sigma: float
    autocorrelation: float
    scatter: float  # (run_scatter/sigma)^2
    misfit: float  # (misfit/sigma)^2


class Products(NamedTuple):
    """Sums over points of products of columns.

    First axis, the points that are summed over: those without a predecessor in their run; those
    with one; the latter times their predecessors, both ways; the predecessors. The columns are the
    derivatives, the functions of the misfit, the level f, and the residual. A part is what is left
    out at a time to judge a curve: a run, or several.
    """

    parts: Float[np.ndarray, "4 parts columns columns"]
    levels: Float[np.ndarray, "4 runs columns"]  # of the level with each column
    part: np.ndarray  # of each run
    points: Float[np.ndarray, " parts"]
    linked: Float[np.ndarray, " parts"]  # points with a predecessor
    log_weight: Float[np.ndarray, " parts"]  # sums of the logarithms of the weights

    @property
    def derivatives(self) -> int:
        return self.parts.shape[-1] - MISFITS - 2


class Allowed(NamedTuple):
    """What of the noise may be estimated, and which derivatives are free."""

    free: Bool[np.ndarray, " derivatives"]
    ordered: bool  # the points of a run are in the order of time
    several: bool  # there are runs, whose levels may differ


def without_correlation(sums: np.ndarray, r: np.ndarray | float) -> np.ndarray:
    """The products [..., *rest] of [4, *rest] under AR(1) noise of correlation r, [...]."""
    r = np.asarray(r)[(..., *(None,) * (sums.ndim - 1))]
    alone, now, crossed, before = sums
    return alone + (now - r * crossed + r**2 * before) / (1 - r**2)


def whitened_sum(
    total: np.ndarray, levels: np.ndarray, r: np.ndarray, scatter: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The products over all runs under the inverse of their noise, in units of sigma.

    `r` and `scatter` are of like shape [choices]; the results are [choices, columns, columns] and
    the log determinants [choices] that the levels of the runs add, halved. The misfit is no part of
    this noise: its functions are columns.
    """
    level = without_correlation(levels, r)
    size = 1 + scatter[:, None] * level[:, :, -2]
    less = (level * (scatter[:, None] / size)[:, :, None]).mT @ level
    return without_correlation(total, r) - less, 0.5 * np.sum(np.log(size), axis=1)


def whitened_parts(found: Products, noise: RunNoise) -> tuple[np.ndarray, np.ndarray]:
    """The same for each part, [parts, columns, columns] and [parts]."""
    level = without_correlation(found.levels, noise.autocorrelation)
    size = 1 + noise.scatter * level[:, -2]
    white = without_correlation(found.parts, noise.autocorrelation)
    growth = np.zeros(len(white))
    np.add.at(growth, found.part, 0.5 * np.log(size))
    if noise.scatter > 0:
        less = (noise.scatter / size)[:, None, None] * level[:, :, None] * level[:, None, :]
        np.subtract.at(white, found.part, less)
    return white, growth


def whitened(found: Products, noise: RunNoise) -> np.ndarray:
    """The products over all runs under this noise, [columns, columns]."""
    r, scatter = np.array([noise.autocorrelation]), np.array([noise.scatter])
    return whitened_sum(found.parts.sum(axis=1), found.levels, r, scatter)[0][0]


def normal_equations(
    white: np.ndarray, misfit: float, free: Bool[np.ndarray, " derivatives"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Matrix and right hand side for free derivatives and misfit, and the columns they belong to.

    `white` may be a stack, [..., columns, columns]. Derivatives come first.
    """
    used = np.flatnonzero(free)
    prior = np.zeros(used.size)
    if misfit > 0:
        used = np.concatenate([used, free.size + np.arange(MISFITS)])
        prior = np.concatenate([prior, _ROUGHNESS / misfit])
    matrix = white[..., used[:, None], used] + np.diag(prior)
    return matrix, white[..., used, -1], used


def estimated(found: Products, allowed: Allowed, floor: float, near: RunNoise | None) -> RunNoise:
    """The noise of greatest restricted likelihood, by grids that close in on it.

    An autocorrelation is estimated only if the points of the runs are in the order of time, the
    scatter of the runs only where there are several. `floor` is the least variance that is taken
    for noise and not for the rounding of numbers. With a noise that is `near`, only about that one.
    Patterson and Thompson 1971, Biometrika 58:545-554; Harville 1977, J. Am. Stat. Assoc.
    72:320-338.
    """
    total, runs = found.parts.sum(axis=1), found.levels.shape[1]
    count, points = found.derivatives, found.points.sum()
    sizes = np.diagonal(total[0] + total[1])
    units = np.array([runs / sizes[-2], 1 / np.mean(sizes[count : count + MISFITS])])
    degrees = max(points - np.sum(allowed.free), 1.0)
    linked = found.linked.sum()
    ordered = allowed.ordered and points > _SHORT * runs
    # What the points tell grows with their number: an autocorrelation, with that of a run.
    highest = np.array([1.0 * ordered, 1.0 * allowed.several, 0.75])
    batch = max(_HELD // (runs * total.shape[-1]), 1)

    def losses(r: np.ndarray, scatter: np.ndarray, misfit: np.ndarray) -> tuple[np.ndarray, ...]:
        """Minus the restricted log likelihoods less a constant and the best sigma^2.

        [choices of r and scatter, choices of misfit].
        """
        white, growth = whitened_sum(total, found.levels, r, scatter)
        quadratic, determinant, values, along = _without_curve(white, allowed.free)
        size = 1 + misfit[:, None] * values[:, None, :]
        explained = np.sum(misfit[:, None] * along[:, None, :] ** 2 / size, axis=-1)
        variance = np.maximum(quadratic[:, None] - explained, 0.0) / degrees + floor
        fixed = determinant + growth + 0.5 * linked * np.log1p(-(r**2))
        loss = 0.5 * degrees * np.log(variance) + fixed[:, None]
        loss = loss + 0.5 * np.sum(np.log(size), axis=-1)
        return np.where(np.isfinite(loss), loss, np.inf), variance

    def search(low: np.ndarray, high: np.ndarray, shape: tuple[int, int, int]) -> tuple:
        axes = [np.unique(np.linspace(a, b, n)) for a, b, n in zip(low, high, shape, strict=True)]
        first, second = (axis.ravel() for axis in np.meshgrid(*axes[:2], indexing="ij"))
        best = (np.inf, np.zeros(3), 1.0)
        for begin in range(0, first.size, batch):
            some = slice(begin, begin + batch)
            noise = _at(first[some], second[some], axes[2], units)
            loss, variance = losses(*noise)
            at = np.unravel_index(np.argmin(loss), loss.shape)
            if loss[at] < best[0] or not np.isfinite(best[0]):
                place = np.array([first[some][at[0]], second[some][at[0]], axes[2][at[1]]])
                best = (loss[at], place, variance[at])
        return best

    if near is None:
        _, place, variance = search(0 * highest, highest, (_FIRST, _FIRST, _FIRST_MISFIT))
        turns = range(_TURNS)
    else:
        place = np.minimum(_place(near, units), highest)
        turns = range(3, _TURNS)
    for turn in turns:
        reach = highest / (_FIRST - 1) * 0.5**turn
        low, high = np.maximum(place - reach, 0.0), np.minimum(place + reach, highest)
        _, place, variance = search(low, high, (_FINER, _FINER, 2 * _FINER - 1))
    first, second, third = place[:, None]
    r, scatter, misfit = (float(one[0]) for one in _at(first, second, third, units))
    return RunNoise(float(np.sqrt(variance)), r, scatter, misfit)


def _at(first: np.ndarray, second: np.ndarray, third: np.ndarray, units: np.ndarray) -> tuple:
    """Autocorrelation, scatter and misfit at places in [0, 1]: 0 at 0, then nearly logarithmic."""
    ratios = (np.expm1(place * np.log1p(_LARGEST_RATIO * 1e3)) / 1e3 for place in (second, third))
    scatter, misfit = (ratio * unit for ratio, unit in zip(ratios, units, strict=True))
    return _MOST_CORRELATED * np.sqrt(first), scatter, misfit


def _place(noise: RunNoise, units: np.ndarray) -> np.ndarray:
    """The inverse of `_at`."""
    ratios = np.array([noise.scatter, noise.misfit]) / units
    places = np.log1p(ratios * 1e3) / np.log1p(_LARGEST_RATIO * 1e3)
    return np.array([(noise.autocorrelation / _MOST_CORRELATED) ** 2, *places])


def _without_curve(white: np.ndarray, free: np.ndarray) -> tuple[np.ndarray, ...]:
    """What is left of stacks of products when the free derivatives are projected out.

    The square of the residual, half the log determinant of the derivatives, and for the functions
    of the misfit, in units of their prior, the eigenvalues of their information and the residual
    along its eigenvectors: the likelihood for any size of the misfit is then a sum over these.
    """
    used = np.flatnonzero(free)
    rest = np.append(free.size + np.arange(MISFITS), white.shape[-1] - 1)
    matrix = white[:, used[:, None], used]
    even, scale = _scaled(matrix)
    across = white[:, used[:, None], rest] * scale[:, :, None]
    left = white[:, rest[:, None], rest] - across.mT @ np.linalg.solve(even, across)
    determinant = _half_log_determinant(matrix)
    prior = 1 / np.sqrt(_ROUGHNESS)
    values, vectors = np.linalg.eigh(left[:, :-1, :-1] * prior[:, None] * prior)
    along = (vectors.mT @ (left[:, :-1, -1:] * prior[:, None]))[:, :, 0]
    return left[:, -1, -1], determinant, np.maximum(values, 0.0), along


def left_out(
    found: Products, noise: RunNoise, inside: Bool[np.ndarray, " derivatives"]
) -> Float[np.ndarray, " parts"]:
    """The log density of each part, given the fit to all others; the noise is that of all runs."""
    white, growth = whitened_parts(found, noise)
    variance = noise.sigma**2
    matrix, right, used = normal_equations(white.sum(axis=0) - white, noise.misfit, inside)
    own, cross = white[:, used[:, None], used], white[:, used, -1]
    best = solve(matrix, right)
    miss = cross - (own @ best[:, :, None])[:, :, 0]
    square = white[:, -1, -1] - np.sum(best * (cross + miss), axis=1)
    square -= np.sum(miss * solve(matrix + own, miss), axis=1)
    spread = _half_log_determinant(matrix + own) - _half_log_determinant(matrix)
    correlated = 0.5 * found.linked * np.log1p(-(noise.autocorrelation**2))
    usual = 0.5 * found.points * np.log(2 * np.pi * variance) + correlated + growth
    return found.log_weight - usual - spread - 0.5 * square / variance


def solve(matrix: Float[np.ndarray, "*b n n"], right: Float[np.ndarray, "*b n"]) -> np.ndarray:
    even, scale = _scaled(matrix)
    return np.linalg.solve(even, (right * scale)[..., None])[..., 0] * scale


def inverse(matrix: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "n n"]:
    even, scale = _scaled(matrix)
    return np.linalg.inv(even) * scale[:, None] * scale


def _half_log_determinant(matrix: Float[np.ndarray, "*b n n"]) -> Float[np.ndarray, "*b"]:
    """Finite though the points do not determine the parameters, as in `solve`."""
    even, scale = _scaled(matrix)
    return 0.5 * np.linalg.slogdet(even)[1] - np.sum(np.log(scale), axis=-1)


def _scaled(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Matrices with diagonals of ones, and the factors that make them so."""
    scale = 1 / np.sqrt(np.maximum(np.diagonal(matrix, axis1=-2, axis2=-1), 1e-300))
    even = matrix * scale[..., :, None] * scale[..., None, :]
    return even + ROUNDING * np.eye(scale.shape[-1]), scale
