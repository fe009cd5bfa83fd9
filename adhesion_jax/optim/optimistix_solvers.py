"""Levenberg-Marquardt and Gauss-Newton of optimistix, imported when they are used."""

from types import ModuleType
from typing import Any

import jax

from adhesion_jax.optim.arrays import Count, Vector
from adhesion_jax.optim.least_squares import Residual, in_the_box

_RTOL, _ATOL = 1e-9, 1e-12


@in_the_box
def levenberg_marquardt(residual: Residual, start: Vector, max_steps: int) -> tuple[Vector, Count]:
    """Optimistix's Levenberg-Marquardt, with a Cholesky solve of the normal equations."""
    optimistix, lineax = _libraries()
    linear = lineax.Normal(lineax.Cholesky())
    solver = optimistix.LevenbergMarquardt(rtol=_RTOL, atol=_ATOL, linear_solver=linear)
    return _solved(solver, residual, start, max_steps)


@in_the_box
def gauss_newton(residual: Residual, start: Vector, max_steps: int) -> tuple[Vector, Count]:
    """Optimistix's Gauss-Newton: full steps, no safeguard."""
    optimistix, lineax = _libraries()
    linear = lineax.AutoLinearSolver(well_posed=None)
    solver = optimistix.GaussNewton(rtol=_RTOL, atol=_ATOL, linear_solver=linear)
    return _solved(solver, residual, start, max_steps)


def _solved(solver: Any, residual: Residual, start: Vector, max_steps: int) -> tuple[Vector, Count]:
    optimistix, _ = _libraries()
    found: Any = optimistix.least_squares(
        lambda u, _: residual(u), solver, start, max_steps=max_steps, throw=False
    )
    return found.value, found.stats["num_steps"]


def _libraries() -> tuple[ModuleType, ModuleType]:
    with jax.ensure_compile_time_eval():  # constants are no part of the program being traced
        import lineax
        import optimistix
    return optimistix, lineax
