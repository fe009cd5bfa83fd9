"""Levenberg-Marquardt and Gauss-Newton of optimistix, imported when they are used."""

from types import ModuleType
from typing import Any

import jax
from jaxtyping import Array, Float, Int

from adhesion_jax.optim.least_squares import Residual, Result, searched

_RTOL, _ATOL = 1e-9, 1e-12


def levenberg_marquardt(
    residual: Residual,
    start: Float[Array, " p"],
    lower: Float[Array, " p"],
    upper: Float[Array, " p"],
    max_steps: int,
) -> Result:
    """Optimistix's Levenberg-Marquardt, with a Cholesky solve of the normal equations."""

    def search(
        residual: Residual, u: Float[Array, " p"]
    ) -> tuple[Float[Array, " p"], Int[Array, ""]]:
        optimistix, lineax = _libraries()
        linear = lineax.Normal(lineax.Cholesky())
        solver = optimistix.LevenbergMarquardt(rtol=_RTOL, atol=_ATOL, linear_solver=linear)
        return _solved(solver, residual, u, max_steps)

    return searched(search, residual, start, lower, upper)


def gauss_newton(
    residual: Residual,
    start: Float[Array, " p"],
    lower: Float[Array, " p"],
    upper: Float[Array, " p"],
    max_steps: int,
) -> Result:
    """Optimistix's Gauss-Newton: full steps, no safeguard."""

    def search(
        residual: Residual, u: Float[Array, " p"]
    ) -> tuple[Float[Array, " p"], Int[Array, ""]]:
        optimistix, lineax = _libraries()
        linear = lineax.AutoLinearSolver(well_posed=None)
        solver = optimistix.GaussNewton(rtol=_RTOL, atol=_ATOL, linear_solver=linear)
        return _solved(solver, residual, u, max_steps)

    return searched(search, residual, start, lower, upper)


def _solved(
    solver: Any, residual: Residual, u: Float[Array, " p"], max_steps: int
) -> tuple[Float[Array, " p"], Int[Array, ""]]:
    optimistix, _ = _libraries()
    found: Any = optimistix.least_squares(
        lambda u, _: residual(u), solver, u, max_steps=max_steps, throw=False
    )
    return found.value, found.stats["num_steps"]


def _libraries() -> tuple[ModuleType, ModuleType]:
    with jax.ensure_compile_time_eval():  # constants are no part of the program being traced
        import lineax
        import optimistix
    return optimistix, lineax
