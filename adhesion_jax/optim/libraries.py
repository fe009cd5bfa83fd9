"""Gradient solvers of other libraries, as peers to compare with; jaxopt is no longer developed.

Their searches work in coordinates without bounds, which a sine maps into the box, and their success
is checked here. A library is imported when it is used, since that takes half a second.
"""

from collections.abc import Callable
from importlib import import_module
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array

from adhesion_jax.optim.arrays import Count, Vector
from adhesion_jax.optim.box import Unbounded, on_bound
from adhesion_jax.optim.least_squares import Residual, Result, Solver, separated
from adhesion_jax.optim.turns import in_groups

#: A Gauss-Newton step below this share of a parameter means six digits are settled.
_SETTLED = 1e-7

#: The Jacobian counts as singular when a scaled column has lost all but this share of its length.
_SINGULAR = 1e-12

#: Tolerances of optimistix.
_TOLERANCES = {"rtol": 1e-9, "atol": 1e-12}

#: Searches of a library that a batch computes together: a block of 500 points took a quarter less
#: time than with 128 of them.
_SIDE_BY_SIDE = 8

#: A search without bounds: the residual, a start and the largest number of steps, to the best place
#: and the steps taken.
LibrarySearch = Callable[[Residual, Vector, int], tuple[Vector, Count]]


def in_the_box(search: LibrarySearch) -> Solver:
    """A decorator that makes a solver of a search of a library, by coordinates without bounds.

    In a batch a few searches at a time: their loops wait for the slowest of these alone.
    """

    def solver(
        residual: Residual, start: Vector, lower: Vector, upper: Vector, max_steps: int
    ) -> Result:
        value, data = separated(residual, start)

        def solve(
            data: list[Array], start: Array, lower: Array, upper: Array
        ) -> tuple[Vector, Count]:
            space = Unbounded.around(start, lower, upper)
            u = space.from_box(start)
            u, steps = search(lambda u: value(data, space.to_box(u)), u, max_steps)
            return space.to_box(u), steps

        x, steps = in_groups(solve, _SIDE_BY_SIDE)(data, start, lower, upper)
        return finish(residual, x, start, lower, upper, steps)

    solver.__name__, solver.__qualname__ = search.__name__, search.__qualname__
    solver.__module__, solver.__doc__ = search.__module__, search.__doc__
    return solver


def finish(
    residual: Residual, x: Vector, start: Vector, lower: Vector, upper: Vector, steps: Count
) -> Result:
    """The result at the x that a library returned, with its success checked again.

    The success that a library reports is not used: the Gauss-Newton step that is left, in the
    parameters that are not held by a bound, must be negligible and the Jacobian of full rank.
    An answer that is not finite is replaced by the start, and is no success.
    """
    value = residual(x)
    finite = jnp.all(jnp.isfinite(x)) & jnp.all(jnp.isfinite(value))
    x = jnp.where(finite, x, start)
    value = jnp.where(finite, value, residual(start))
    jacobian = jax.jacfwd(residual)(x)
    converged = finite & _is_minimum(jacobian, x, value, lower, upper)
    evaluations = steps * (1 + x.size)
    return Result(x, jnp.sum(value**2), jacobian.T @ jacobian, steps, evaluations, converged)


def _is_minimum(jacobian: Array, x: Array, value: Array, lower: Array, upper: Array) -> Array:
    gradient = value @ jacobian
    low_side = x - lower < upper - x
    held = on_bound(x, lower, upper) & jnp.where(low_side, gradient > 0, gradient < 0)
    length = jnp.linalg.norm(jacobian, axis=0)
    nonzero = jnp.all(jnp.isfinite(jacobian)) & jnp.all(held | (length > 0))
    scaled = jnp.where(held | ~nonzero, 0.0, jacobian / jnp.where(length > 0, length, 1.0))
    # Held columns become unit vectors of extra rows: they take no part, and keep R regular.
    rows = jnp.diag(jnp.where(held | ~nonzero, 1.0, 0.0))
    q, r = jnp.linalg.qr(jnp.concatenate([scaled, rows]))
    full_rank = nonzero & (jnp.min(jnp.abs(jnp.diag(r))) > _SINGULAR)
    projected = jnp.where(jnp.isfinite(value), value, 0.0) @ q[: value.size]
    safe_r = jnp.where(full_rank, r, jnp.eye(x.size))
    step = jax.scipy.linalg.solve_triangular(safe_r, projected) / jnp.where(length > 0, length, 1.0)
    settled = jnp.all(held | (jnp.abs(step) <= _SETTLED * jnp.abs(x)))
    return full_rank & settled


@in_the_box
def jaxopt_levenberg_marquardt(
    residual: Residual, start: Vector, max_steps: int
) -> tuple[Vector, Count]:
    """Jaxopt's Levenberg-Marquardt, with the Jacobian materialised and a Cholesky solve."""
    solver = _library("jaxopt").LevenbergMarquardt(
        residual,
        maxiter=max_steps,
        stop_criterion="madsen-nielsen",
        xtol=1e-9,
        gtol=0.0,
        materialize_jac=True,
        solver="cholesky",
    )
    best, state = solver.run(start)
    return best, jnp.asarray(state.iter_num)


@in_the_box
def jaxopt_gauss_newton(residual: Residual, start: Vector, max_steps: int) -> tuple[Vector, Count]:
    """Jaxopt's Gauss-Newton: full steps, no safeguard."""
    solver = _library("jaxopt").GaussNewton(residual, maxiter=max_steps, tol=1e-9)
    best, state = solver.run(start)
    return best, jnp.asarray(state.iter_num)


@in_the_box
def optimistix_levenberg_marquardt(
    residual: Residual, start: Vector, max_steps: int
) -> tuple[Vector, Count]:
    """Optimistix's Levenberg-Marquardt, with a Cholesky solve of the normal equations."""
    lineax = _library("lineax")
    linear = lineax.Normal(lineax.Cholesky())
    solver = _library("optimistix").LevenbergMarquardt(**_TOLERANCES, linear_solver=linear)
    return _by_optimistix(solver, residual, start, max_steps)


@in_the_box
def optimistix_gauss_newton(
    residual: Residual, start: Vector, max_steps: int
) -> tuple[Vector, Count]:
    """Optimistix's Gauss-Newton: full steps, no safeguard."""
    linear = _library("lineax").AutoLinearSolver(well_posed=None)
    solver = _library("optimistix").GaussNewton(**_TOLERANCES, linear_solver=linear)
    return _by_optimistix(solver, residual, start, max_steps)


def _by_optimistix(
    solver: Any, residual: Residual, start: Vector, max_steps: int
) -> tuple[Vector, Count]:
    found = _library("optimistix").least_squares(
        lambda u, _: residual(u), solver, start, max_steps=max_steps, throw=False
    )
    return found.value, found.stats["num_steps"]


def _library(name: str) -> Any:
    with jax.ensure_compile_time_eval():  # its constants are no part of the program being traced
        return import_module(name)
