"""Exact box-constrained least squares for y ~ a phi(x; nu) + b psi(x).

Given nu the problem is linear in a and b (Golub and Pereyra 1973, SIAM J. Numer. Anal. 10),
so the search is one-dimensional. The data are reduced to sums that are smooth functions of
nu, each a Chebyshev series in nu/(nu + s), s a third of the largest nu: computed once from the
points, they give the objective anywhere in the box at the cost of three short series, and the sums
of two sets of data add up.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from numpy.polynomial.chebyshev import chebvander

from adhesion_jax.optim.arrays import Count, Value, Whether
from adhesion_jax.optim.quadratic_program import Products, bounded_pair

N = TypeVar("N", float, Array)

#: For phi = 1 - exp(-nu x), x <= 1 and nu in [1, 50] the truncated series is exact to 2e-13, which
#: would take 54 terms in nu and 40 in its root.
DEGREE = 28

#: s as a share of the largest nu: near the best for boxes from [1, 50] to [10, 500].
_BEND_OF_MAP = 1 / 3

_GRID = 64
_STEPS = 60

#: A search ends with a step shorter than this (a cell of the grid is 1), or where the slope of the
#: profile is this share of its three parts.
_NEAR, _ROUNDING = 1e-13, 1e-15

#: Degree of the polynomials that stand for the series in two cells of the grid, which add 1e-14 to
#: its error. A step of the search then costs a quarter of what the series would.
_LOCAL_DEGREE = 9

_ANGLES = np.pi * (np.arange(DEGREE) + 0.5) / DEGREE
_NODES = np.cos(_ANGLES)
# Values at the Chebyshev nodes to the coefficients of the series.
_TO_SERIES = (2.0 / DEGREE) * np.cos(np.outer(np.arange(DEGREE), _ANGLES))
_TO_SERIES[0] /= 2.0
_GRID_POINTS = np.cos(np.linspace(np.pi, 0.0, _GRID))
_TO_GRID = chebvander(_GRID_POINTS, DEGREE - 1)
# The two cells about each point of the grid (one at the ends), and the series there as powers of
# t, x = middle + half t and -1 <= t <= 1: [grid, degree, powers].
_LOW = _GRID_POINTS[np.maximum(np.arange(_GRID) - 1, 0)]
_HIGH = _GRID_POINTS[np.minimum(np.arange(_GRID) + 1, _GRID - 1)]
_MIDDLE, _HALF = 0.5 * (_LOW + _HIGH), 0.5 * (_HIGH - _LOW)


def _to_powers() -> np.ndarray:
    """The interpolation of the series at Chebyshev points of the cells.

    By way of the powers of t that are exact, of which those beyond the local degree, small in a
    cell, are interpolated: interpolation of the series themselves would lose three digits.
    """
    exact = np.zeros((DEGREE, DEGREE, _GRID))  # of T_d(middle + half t): [d, powers, grid]
    exact[0, 0], exact[1, 0], exact[1, 1] = 1.0, _MIDDLE, _HALF
    for d in range(2, DEGREE):
        exact[d] = 2 * _MIDDLE * exact[d - 1] - exact[d - 2]
        exact[d, 1:] += 2 * _HALF * exact[d - 1, :-1]
    size = _LOCAL_DEGREE + 1
    nodes = np.cos(np.pi * (np.arange(size) + 0.5) / size)
    powers = nodes[:, None] ** np.arange(DEGREE)
    of_high = np.linalg.solve(powers[:, :size], powers[:, size:])
    low, high = exact[:, :size], exact[:, size:]
    return np.moveaxis(low + np.einsum("nk,dkg->dng", of_high, high), 2, 0)


_TO_POWERS = _to_powers()


class Sums(NamedTuple):
    """Sufficient statistics of the data, additive over data taken with the same nu range."""

    yy: Value
    y_psi: Value
    psi_psi: Value
    y_phi: Float[Array, " degree"]  # Chebyshev series in nu/(nu + s)
    phi_phi: Float[Array, " degree"]
    phi_psi: Float[Array, " degree"]


class Jet(NamedTuple):
    """A function of nu with its first and second derivative."""

    value: Value
    slope: Value
    bend: Value


class _Place(NamedTuple):
    """A place t in the bracket of each run: a, b, the sums, and the slope of the profile there."""

    t: Float[Array, " runs"]
    a: Float[Array, " runs"]
    b: Float[Array, " runs"]
    values: Float[Array, "series runs"]
    slopes: Float[Array, "series runs"]
    bends: Float[Array, "series runs"]
    slope: Float[Array, " runs"]


class _Search(NamedTuple):
    """The search of each run: its bracket, the slopes at the ends, and the last place.

    All that is wanted of the last place is carried: after the loop the compiler would compute it
    once more for each of its uses.
    """

    steps: Int[Array, " runs"]
    low: Float[Array, " runs"]
    high: Float[Array, " runs"]
    slope_low: Float[Array, " runs"]
    slope_high: Float[Array, " runs"]
    last: Float[Array, " runs"]  # 1 where the low end moved last, -1 where the high end did
    at: _Place
    ended: Bool[Array, " runs"]


#: The place t of each run in its bracket, and whether the profile is level there.
_Evaluated = Callable[[Float[Array, " runs"]], tuple[_Place, Bool[Array, " runs"]]]


class Solution(NamedTuple):
    """The optimum, and the sums of phi^2 and phi psi there, which the information is made of."""

    a: Value
    b: Value
    nu: Value
    objective: Value
    phi_phi: Jet
    phi_psi: Jet
    evaluations: Count  # of the objective
    converged: Whether


def summarise(
    phi: Callable[[Float[Array, "degree 1"]], Float[Array, "degree points"]],
    psi: Float[Array, " points"],
    y: Float[Array, " points"],
    mask: Bool[Array, " points"],
    nu_lower: Value,
    nu_upper: Value,
) -> Sums:
    """Sums over the points for every nu between the bounds (positive).

    The matrix of phi at the Chebyshev nodes depends on the abscissae alone; where a batch of
    data shares them, what is left for each set is one matrix-vector product.
    """
    values = jnp.where(mask, phi(_nu(jnp.asarray(_NODES), nu_lower, nu_upper)[:, None]), 0.0)
    y, psi = jnp.where(mask, y, 0.0), jnp.where(mask, psi, 0.0)
    series = jnp.asarray(_TO_SERIES)
    of_y = jnp.concatenate([values, psi[None]]) @ y
    return Sums(
        yy=jnp.sum(y * y),
        y_psi=of_y[-1],
        psi_psi=jnp.sum(psi * psi),
        y_phi=series @ of_y[:-1],
        phi_phi=series @ jnp.sum(values * values, axis=1),
        phi_psi=series @ (values @ psi),
    )


def sum_of_squares(
    sums: Sums,
    a: Float[Array, "*shape"],
    nu: Float[Array, "*shape"],
    b: Float[Array, "*shape"],
    nu_lower: Value,
    nu_upper: Value,
) -> Float[Array, "*shape"]:
    """Sum (y - a phi(x; nu) - b psi(x))^2 from the sums alone."""
    x = _chebyshev_variable(nu, nu_lower, nu_upper)
    return _expand(sums, a, b, *_series((sums.y_phi, sums.phi_phi, sums.phi_psi), x))


@jax.custom_batching.custom_vmap
def minimise(sums: Sums, lower: Float[Array, "3"], upper: Float[Array, "3"]) -> Solution:
    """The global optimum over the box; bounds are in the order a, nu, b.

    The profile over nu is evaluated on a grid. About its least point the sums become short
    polynomials, with which the derivative of the profile (at the optimal a and b the partial one,
    by the envelope theorem) is brought to zero by regula falsi (Illinois). The derivative, not the
    objective, so that full precision is kept.
    """
    one_run = jax.tree.map(lambda x: x[..., None], (sums, lower, upper))
    solution: Solution = jax.tree.map(lambda x: x[0], _minimise(*one_run))
    return solution


@minimise.def_vmap
def _minimise_batch(
    size: int, batched: list, sums: Sums, lower: Array, upper: Array
) -> tuple[Solution, Solution]:
    """Batches have their run axis last: a coefficient of all runs is then contiguous in memory."""
    run_last = jax.tree.map(
        lambda is_batched, x: jnp.moveaxis(x, 0, -1) if is_batched else x[..., None],
        tuple(batched),
        (sums, lower, upper),
    )
    solution = jax.tree.map(lambda x: jnp.broadcast_to(x, (size,)), _minimise(*run_last))
    return solution, jax.tree.map(lambda _: True, solution)


def _minimise(sums: Sums, lower: Float[Array, "3 ..."], upper: Float[Array, "3 ..."]) -> Solution:
    """`minimise` for any number of runs; the last axis of every array is that of the runs.

    What they share, as the sums of phi^2 on a common grid of slips, has one run there.
    """
    a_range, b_range = (lower[0], upper[0]), (lower[2], upper[2])
    series = (sums.y_phi, sums.phi_phi, sums.phi_psi)

    def linear_part(y_phi: Array, phi_phi: Array, phi_psi: Array) -> tuple[Array, Array]:
        products = Products(y_phi, sums.y_psi, phi_phi, sums.psi_psi, phi_psi)
        return bounded_pair(products, a_range, b_range)

    on_grid = tuple(jnp.tensordot(jnp.asarray(_TO_GRID), c, 1) for c in series)
    profile = _expand(sums, *linear_part(*on_grid), *on_grid)
    # Not argmin, whose loop over pairs of value and index takes as long as the profile itself.
    is_least = profile <= jnp.min(profile, axis=0)
    place = jnp.where(is_least, jnp.arange(float(_GRID))[:, None], _GRID - 1.0)
    cell = jnp.min(place, axis=0).astype(jnp.int32)
    shape = (_LOCAL_DEGREE + 1, *cell.shape)
    powers = jnp.stack([jnp.broadcast_to(_powers(c, cell), shape) for c in series], axis=1)

    def evaluated(t: Float[Array, " runs"]) -> tuple[_Place, Bool[Array, " runs"]]:
        values, slopes, bends = _polynomials(powers, t)
        a, b = linear_part(*values)
        parts = a * a * slopes[1], 2 * a * b * slopes[2], -2 * a * slopes[0]
        slope = parts[0] + parts[1] + parts[2]
        size = jnp.abs(parts[0]) + jnp.abs(parts[1]) + jnp.abs(parts[2])
        return _Place(t, a, b, values, slopes, bends, slope), jnp.abs(slope) <= _ROUNDING * size

    nothing = jnp.zeros(cell.shape)
    none = jnp.zeros((len(series), *cell.shape))
    start = _Search(
        jnp.zeros(cell.shape, dtype=jnp.int32),
        nothing - 1,
        nothing + 1,
        nothing,
        nothing,
        nothing,
        _Place(nothing, nothing, nothing, none, none, none, nothing),
        jnp.zeros(cell.shape, dtype=bool),
    )
    found = jax.lax.while_loop(
        lambda search: jnp.any(~search.ended & (search.steps < _STEPS)),
        partial(_advanced, evaluated),
        start,
    )
    return _solution(sums, found, cell, lower[1], upper[1])


def _advanced(evaluated: _Evaluated, search: _Search) -> _Search:
    """Regula falsi (Illinois); the first two places are the ends of the bracket."""
    low, high = search.low, search.high
    rise = search.slope_high - search.slope_low
    across = (low * search.slope_high - high * search.slope_low) / rise
    t = jnp.clip(jnp.where(rise > 0, across, 0.5 * (low + high)), low, high)
    t = jnp.where(search.steps == 0, low, jnp.where(search.steps == 1, high, t))
    at, level = evaluated(t)
    falling = at.slope < 0
    # If the same end is kept twice in a row, its slope is halved.
    slope_high = jnp.where(falling & (search.last > 0), 0.5, 1.0) * search.slope_high
    slope_low = jnp.where(~falling & (search.last < 0), 0.5, 1.0) * search.slope_low
    moved = _Search(
        search.steps + 1,
        # Where the profile does not change its direction between them, both ends become one.
        jnp.where(falling, t, low),
        jnp.where(falling, high, t),
        jnp.where(falling, at.slope, slope_low),
        jnp.where(falling, slope_high, at.slope),
        jnp.where(search.steps < 2, 0.0, jnp.where(falling, 1.0, -1.0)),
        at,
        level | ((jnp.abs(t - search.at.t) <= _NEAR) & (search.steps > 1)),
    )
    # What a run finds does not depend on how long others of its batch go on.
    kept: _Search = jax.tree.map(lambda old, new: jnp.where(search.ended, old, new), search, moved)
    return kept


def _solution(
    sums: Sums,
    found: _Search,
    cell: Int[Array, " runs"],
    nu_lower: Float[Array, "..."],
    nu_upper: Float[Array, "..."],
) -> Solution:
    """The optimum at the last place of a search, with derivatives by nu instead of by t."""
    root, a, b, (y_phi, phi_phi, phi_psi), slopes, bends, _ = found.at
    half = jnp.asarray(_HALF)[cell]
    share_low, share_high, bend = _map(nu_lower, nu_upper)
    nu = _nu(jnp.asarray(_MIDDLE)[cell] + half * root, nu_lower, nu_upper)
    width = half * 0.5 * (share_high - share_low)  # d share/dt
    by_nu = bend / (nu + bend) ** 2  # d share/d nu
    by_share = slopes / width
    slopes = by_share * by_nu
    bends = by_nu * (bends / width**2 * by_nu - 2 * by_share / (nu + bend))
    return Solution(
        a,
        b,
        nu,
        _expand(sums, a, b, y_phi, phi_phi, phi_psi),
        Jet(phi_phi, slopes[1], bends[1]),
        Jet(phi_psi, slopes[2], bends[2]),
        _GRID + found.steps,
        found.ended,
    )


def _powers(series: Float[Array, "degree sets"], cell: Int[Array, " runs"]) -> Array:
    """The series in the cells about a point of the grid for each run: coefficients of powers of t.

    A series that the runs share is brought to powers once for every cell.
    """
    table = jnp.asarray(_TO_POWERS)
    if series.shape[-1] == 1:
        return jnp.einsum("gnd,n->dg", table, series[:, 0])[:, cell]
    return jnp.einsum("nr,rnd->dr", series, table[cell])


def _polynomials(
    powers: Float[Array, "powers series runs"], t: Float[Array, " runs"]
) -> tuple[Array, Array, Array]:
    """Polynomials [series, runs] with their first and second derivatives (Horner)."""
    value = slope = half_bend = jnp.zeros(powers.shape[1:])
    for coefficient in powers[::-1]:
        half_bend = half_bend * t + slope
        slope = slope * t + value
        value = value * t + coefficient
    return value, slope, 2 * half_bend


def series_error(
    function: Callable[[np.ndarray], np.ndarray], nu_lower: float, nu_upper: float
) -> float:
    """The largest error on the grid of the series of a function of nu, [nu, ...]."""
    low, high, bend = _map(nu_lower, nu_upper)

    def at(x: np.ndarray) -> np.ndarray:
        share = 0.5 * (low + high) + 0.5 * (high - low) * x
        return function(bend * share / (1 - share))

    return float(np.abs(_TO_GRID @ (_TO_SERIES @ at(_NODES)) - at(_GRID_POINTS)).max())


def _map(nu_lower: N, nu_upper: N) -> tuple[N, N, N]:
    """Of the map nu/(nu + s): its values at both ends, and s."""
    bend = _BEND_OF_MAP * nu_upper
    return nu_lower / (nu_lower + bend), nu_upper / (nu_upper + bend), bend


def _nu(x: Array, nu_lower: Array, nu_upper: Array) -> Array:
    low, high, bend = _map(nu_lower, nu_upper)
    share = 0.5 * (low + high) + 0.5 * (high - low) * x
    return jnp.clip(bend * share / (1 - share), nu_lower, nu_upper)


def _chebyshev_variable(nu: Array, nu_lower: Array, nu_upper: Array) -> Array:
    low, high, bend = _map(nu_lower, nu_upper)
    return (2 * nu / (nu + bend) - (low + high)) / (high - low)


def _series(
    coefficients: tuple[Float[Array, " degree"], ...], x: Float[Array, "*shape"]
) -> tuple[Array, ...]:
    """Chebyshev series at x by Clenshaw's recurrence."""
    zero = jnp.zeros(x.shape)
    sums = [(zero, zero)] * len(coefficients)
    for k in range(DEGREE - 1, 0, -1):
        sums = [
            (c[k] + 2 * x * last - before, last)
            for c, (last, before) in zip(coefficients, sums, strict=True)
        ]
    return tuple(
        c[0] + x * last - before for c, (last, before) in zip(coefficients, sums, strict=True)
    )


def _expand(sums: Sums, a: Array, b: Array, y_phi: Array, phi_phi: Array, phi_psi: Array) -> Array:
    return (
        sums.yy
        - 2 * (a * y_phi + b * sums.y_psi)
        + a * (a * phi_phi + 2 * b * phi_psi)
        + b * b * sums.psi_psi
    )
