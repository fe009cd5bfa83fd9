"""Levenberg-Marquardt and Gauss-Newton of optimistix, imported when they are used."""

from types import ModuleType
from typing import Any

import jax
from jaxtyping import Array, Float

from adhesion_jax.optim.box import Unbounded
from adhesion_jax.optim.least_squares import Residual, Result, finish

_RTOL, _ATOL = 1e-9, 1e-12


def levenberg_marquardt(
    residual: Residual,
    start: Float[Array, " p"],
    lower: Float[Array, " p"],
    upper: Float[Array, " p"],
    max_steps: int,
) -> Result:
    """Optimistix's Levenberg-Marquardt, with a Cholesky solve of the normal equations."""
    optimistix, lineax = _libraries()
    linear = lineax.Normal(lineax.Cholesky())
    solver: Any = optimistix.LevenbergMarquardt(rtol=_RTOL, atol=_ATOL, linear_solver=linear)
    return _solve(solver, residual, start, lower, upper, max_steps)


def gauss_newton(
    residual: Residual,
    start: Float[Array, " p"],
    lower: Float[Array, " p"],
    upper: Float[Array, " p"],
    max_steps: int,
) -> Result:
    """Optimistix's Gauss-Newton: full steps, no safeguard."""
    optimistix, lineax = _libraries()
    linear = lineax.AutoLinearSolver(well_posed=None)
    solver: Any = optimistix.GaussNewton(rtol=_RTOL, atol=_ATOL, linear_solver=linear)
    return _solve(solver, residual, start, lower, upper, max_steps)


def _solve(
    solver: Any,
    residual: Residual,
    start: Array,
    lower: Array,
    upper: Array,
    max_steps: int,
) -> Result:
    optimistix, _ = _libraries()
    space = Unbounded.around(start, lower, upper)
    solution: Any = optimistix.least_squares(
        lambda u, _: residual(space.to_box(u)),
        solver,
        space.from_box(start),
        max_steps=max_steps,
        throw=False,
    )
    return finish(
        residual,
        space.to_box(solution.value),
        start,
        lower,
        upper,
        solution.stats["num_steps"],
    )


def _libraries() -> tuple[ModuleType, ModuleType]:
    with jax.ensure_compile_time_eval():  # constants are no part of the program being traced
        import lineax
        import optimistix
    return optimistix, lineax
