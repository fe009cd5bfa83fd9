"""Levenberg-Marquardt and Gauss-Newton of jaxopt.

jaxopt is no longer developed; it stays as a peer to compare with, behind this file alone. It is
imported when it is used, since that takes half a second.
"""

from types import ModuleType

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from adhesion_jax.optim.least_squares import Residual, Result, searched


def levenberg_marquardt(
    residual: Residual,
    start: Float[Array, " p"],
    lower: Float[Array, " p"],
    upper: Float[Array, " p"],
    max_steps: int,
) -> Result:
    """Jaxopt's Levenberg-Marquardt, with the Jacobian materialised and a Cholesky solve."""

    def search(
        residual: Residual, u: Float[Array, " p"]
    ) -> tuple[Float[Array, " p"], Int[Array, ""]]:
        solver = _jaxopt().LevenbergMarquardt(
            residual,
            maxiter=max_steps,
            stop_criterion="madsen-nielsen",
            xtol=1e-9,
            gtol=0.0,
            materialize_jac=True,
            solver="cholesky",
        )
        u, state = solver.run(u)
        return u, jnp.asarray(state.iter_num)

    return searched(search, residual, start, lower, upper)


def gauss_newton(
    residual: Residual,
    start: Float[Array, " p"],
    lower: Float[Array, " p"],
    upper: Float[Array, " p"],
    max_steps: int,
) -> Result:
    """Jaxopt's Gauss-Newton: full steps, no safeguard."""

    def search(
        residual: Residual, u: Float[Array, " p"]
    ) -> tuple[Float[Array, " p"], Int[Array, ""]]:
        u, state = _jaxopt().GaussNewton(residual, maxiter=max_steps, tol=1e-9).run(u)
        return u, jnp.asarray(state.iter_num)

    return searched(search, residual, start, lower, upper)


def _jaxopt() -> ModuleType:
    with jax.ensure_compile_time_eval():  # its constants are no part of the program being traced
        import jaxopt
    return jaxopt
