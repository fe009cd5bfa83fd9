"""Exact box-constrained least squares for y ~ a phi(x; nu) + b psi(x).

Given nu the problem is linear in a and b (Golub and Pereyra 1973, SIAM J. Numer. Anal. 10),
so the search is one-dimensional. The data are reduced to sums that are smooth functions of
nu, each a Chebyshev series in sqrt(nu): computed once from the points, they give the objective
anywhere in the box at the cost of three short series, and the sums of two sets of data add up.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from numpy.polynomial.chebyshev import chebder, chebvander

from adhesion_jax.optim.quadratic_program import bounded_pair

#: For phi = 1 - exp(-nu x), x <= 1 and nu in [1, 50] the truncated series is exact to 2e-13.
DEGREE = 40

_GRID = 64
_SECANTS = 16

#: Number of steps of the recurrence that are unrolled: all of them if the series is most of the
#: work (a search by population), else few, because compiling a long program takes longer than it
#: saves.
_UNROLL = 3

Pair = tuple[Array, Array]

_ANGLES = np.pi * (np.arange(DEGREE) + 0.5) / DEGREE
_NODES = np.cos(_ANGLES)
# Values at the Chebyshev nodes to the coefficients of the series.
_TO_SERIES = (2.0 / DEGREE) * np.cos(np.outer(np.arange(DEGREE), _ANGLES))
_TO_SERIES[0] /= 2.0
_GRID_POINTS = np.cos(np.linspace(np.pi, 0.0, _GRID))
_TO_GRID = chebvander(_GRID_POINTS, DEGREE - 1)
_TO_GRID_SLOPE = chebvander(_GRID_POINTS, DEGREE - 2) @ chebder(np.eye(DEGREE))


class Sums(NamedTuple):
    """Sufficient statistics of the data, additive over data taken with the same nu range."""

    yy: Float[Array, ""]
    y_psi: Float[Array, ""]
    psi_psi: Float[Array, ""]
    y_phi: Float[Array, " degree"]  # Chebyshev series in sqrt(nu)
    phi_phi: Float[Array, " degree"]
    phi_psi: Float[Array, " degree"]


class Solution(NamedTuple):
    a: Float[Array, ""]
    b: Float[Array, ""]
    nu: Float[Array, ""]
    objective: Float[Array, ""]


#: Objective evaluations of one exact solution: the grid, then the secant steps.
EVALUATIONS = _GRID + _SECANTS


def summarise(
    phi: Callable[[Float[Array, "degree 1"]], Float[Array, "degree points"]],
    psi: Float[Array, " points"],
    y: Float[Array, " points"],
    mask: Bool[Array, " points"],
    nu_lower: Float[Array, ""],
    nu_upper: Float[Array, ""],
) -> Sums:
    """Sums over the points for every nu between the bounds (positive).

    The matrix of phi at the Chebyshev nodes depends on the abscissae alone; where a batch of
    data shares them, what is left for each set is one matrix-vector product.
    """
    values = jnp.where(mask, phi(_nu(jnp.asarray(_NODES), nu_lower, nu_upper)[:, None]), 0.0)
    y, psi = jnp.where(mask, y, 0.0), jnp.where(mask, psi, 0.0)
    series = jnp.asarray(_TO_SERIES)
    return Sums(
        yy=jnp.sum(y * y),
        y_psi=jnp.sum(y * psi),
        psi_psi=jnp.sum(psi * psi),
        y_phi=series @ (values @ y),
        phi_phi=series @ jnp.sum(values * values, axis=1),
        phi_psi=series @ (values @ psi),
    )


def sum_of_squares(
    sums: Sums,
    a: Float[Array, "*shape"],
    nu: Float[Array, "*shape"],
    b: Float[Array, "*shape"],
    nu_lower: Float[Array, ""],
    nu_upper: Float[Array, ""],
) -> Float[Array, "*shape"]:
    """Sum (y - a phi(x; nu) - b psi(x))^2 from the sums alone."""
    x = _chebyshev_variable(nu, nu_lower, nu_upper)
    return _expand(sums, a, b, *_series((sums.y_phi, sums.phi_phi, sums.phi_psi), x, DEGREE))


def sums_at(
    sums: Sums,
    nu: Float[Array, "*shape"],
    nu_lower: Float[Array, ""],
    nu_upper: Float[Array, ""],
) -> tuple[Float[Array, "*shape"], Float[Array, "*shape"], Float[Array, "*shape"]]:
    """Sum y phi, sum phi^2 and sum phi psi at one nu."""
    x = _chebyshev_variable(nu, nu_lower, nu_upper)
    y_phi, phi_phi, phi_psi = _series((sums.y_phi, sums.phi_phi, sums.phi_psi), x, _UNROLL)
    return y_phi, phi_phi, phi_psi


@jax.custom_batching.custom_vmap
def minimise(sums: Sums, lower: Float[Array, "3"], upper: Float[Array, "3"]) -> Solution:
    """The global optimum over the box; bounds are in the order a, nu, b.

    The profile over nu is evaluated on a grid, then its derivative (at the optimal a and b the
    partial one, by the envelope theorem) is brought to zero in the best two cells by regula
    falsi (Illinois). The derivative, not the objective, so that full precision is kept.
    """
    return _minimise(sums, lower, upper)


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
    """`minimise` for any number of runs, whose axes come last in every array."""
    a_range, b_range = (lower[0], upper[0]), (lower[2], upper[2])
    series = (sums.y_phi, sums.phi_phi, sums.phi_psi)

    def linear_part(values: tuple[Array, ...]) -> tuple[Array, Array]:
        y_phi, phi_phi, phi_psi = values
        return bounded_pair(y_phi, sums.y_psi, phi_phi, sums.psi_psi, phi_psi, a_range, b_range)

    def slope_of_profile(values: tuple[Array, ...], slopes: tuple[Array, ...]) -> Array:
        a, b = linear_part(values)
        y_phi_slope, phi_phi_slope, phi_psi_slope = slopes
        return a * (a * phi_phi_slope + 2 * b * phi_psi_slope - 2 * y_phi_slope)

    on_grid = tuple(jnp.tensordot(jnp.asarray(_TO_GRID), c, 1) for c in series)
    slopes_on_grid = tuple(jnp.tensordot(jnp.asarray(_TO_GRID_SLOPE), c, 1) for c in series)
    best = jnp.argmin(_expand(sums, *linear_part(on_grid), *on_grid), axis=0)
    slope_on_grid = slope_of_profile(on_grid, slopes_on_grid)

    def at(node: Array) -> tuple[Array, Array]:
        slope = jnp.take_along_axis(slope_on_grid, node[None], axis=0)[0]
        return jnp.asarray(_GRID_POINTS)[node], slope

    def secant(_: Int[Array, ""], bracket: tuple[Array, ...]) -> tuple[Array, ...]:
        low, high, slope_low, slope_high, last = bracket
        rise = slope_high - slope_low
        x = jnp.where(rise > 0, (low * slope_high - high * slope_low) / rise, 0.5 * (low + high))
        x = jnp.clip(x, low, high)
        values, slopes = jax.jvp(lambda x: _series(series, x, _UNROLL), (x,), (jnp.ones_like(x),))
        # The barrier keeps the compiler from evaluating the series once for each of its uses.
        x, slope = jax.lax.optimization_barrier((x, slope_of_profile(values, slopes)))
        falling = slope < 0
        # Illinois: if the same end is kept twice in a row, its slope is halved.
        slope_high = jnp.where(falling & (last > 0), 0.5 * slope_high, slope_high)
        slope_low = jnp.where(~falling & (last < 0), 0.5 * slope_low, slope_low)
        return (
            jnp.where(falling, x, low),
            jnp.where(falling, high, x),
            jnp.where(falling, slope, slope_low),
            jnp.where(falling, slope_high, slope),
            jnp.where(falling, 1.0, -1.0),
        )

    first_low, first_slope_low = at(jnp.maximum(best - 1, 0))
    first_high, first_slope_high = at(jnp.minimum(best + 1, _GRID - 1))
    start = (first_low, first_high, first_slope_low, first_slope_high, jnp.zeros_like(first_low))
    low, high, slope_low, slope_high, _ = jax.lax.fori_loop(0, _SECANTS, secant, start)
    root = jnp.where(jnp.abs(slope_low) < jnp.abs(slope_high), low, high)
    # No sign change in the bracket: the optimum is the bound of nu that the profile falls to.
    root = jnp.where(first_slope_high <= 0, first_high, root)
    root = jnp.where(first_slope_low >= 0, first_low, root)
    values = _series(series, root, _UNROLL)
    a, b = linear_part(values)
    return Solution(a, b, _nu(root, lower[1], upper[1]), _expand(sums, a, b, *values))


def _nu(x: Array, nu_lower: Array, nu_upper: Array) -> Array:
    low, high = jnp.sqrt(nu_lower), jnp.sqrt(nu_upper)
    return jnp.clip((0.5 * (low + high) + 0.5 * (high - low) * x) ** 2, nu_lower, nu_upper)


def _chebyshev_variable(nu: Array, nu_lower: Array, nu_upper: Array) -> Array:
    low, high = jnp.sqrt(nu_lower), jnp.sqrt(nu_upper)
    return (2 * jnp.sqrt(nu) - (low + high)) / (high - low)


def _series(
    coefficients: tuple[Float[Array, "degree ..."], ...], x: Float[Array, "..."], unroll: int
) -> tuple[Array, ...]:
    """Chebyshev series at x by Clenshaw's recurrence, `unroll` of its steps in a row."""

    def step(
        carry: tuple[Pair, ...], of_degree: tuple[Array, ...]
    ) -> tuple[tuple[Pair, ...], None]:
        pairs = zip(carry, of_degree, strict=True)
        return tuple((c + 2 * x * last - before, last) for (last, before), c in pairs), None

    shapes = [jnp.broadcast_shapes(c.shape[1:], x.shape) for c in coefficients]
    start = tuple((jnp.zeros(shape), jnp.zeros(shape)) for shape in shapes)
    higher = tuple(c[:0:-1] for c in coefficients)
    sums, _ = jax.lax.scan(step, start, higher, unroll=unroll)
    pairs = zip(coefficients, sums, strict=True)
    return tuple(c[0] + x * last - before for c, (last, before) in pairs)


def _expand(sums: Sums, a: Array, b: Array, y_phi: Array, phi_phi: Array, phi_psi: Array) -> Array:
    return (
        sums.yy
        - 2 * (a * y_phi + b * sums.y_psi)
        + a * (a * phi_phi + 2 * b * phi_psi)
        + b * b * sums.psi_psi
    )
