"""Levenberg-Marquardt and Gauss-Newton of jaxopt.

jaxopt is no longer developed; it stays as a peer to compare with, behind this file alone. It is
imported when it is used, since that takes half a second.
"""

from types import ModuleType

import jax
import jax.numpy as jnp

from adhesion_jax.optim.arrays import Count, Vector
from adhesion_jax.optim.least_squares import Residual, in_the_box


@in_the_box
def levenberg_marquardt(residual: Residual, start: Vector, max_steps: int) -> tuple[Vector, Count]:
    """Jaxopt's Levenberg-Marquardt, with the Jacobian materialised and a Cholesky solve."""
    solver = _jaxopt().LevenbergMarquardt(
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
def gauss_newton(residual: Residual, start: Vector, max_steps: int) -> tuple[Vector, Count]:
    """Jaxopt's Gauss-Newton: full steps, no safeguard."""
    best, state = _jaxopt().GaussNewton(residual, maxiter=max_steps, tol=1e-9).run(start)
    return best, jnp.asarray(state.iter_num)


def _jaxopt() -> ModuleType:
    with jax.ensure_compile_time_eval():  # its constants are no part of the program being traced
        import jaxopt
    return jaxopt
