"""Levenberg-Marquardt and Gauss-Newton of jaxopt.

jaxopt is no longer developed; it stays as a peer to compare with, behind this file alone. It is
imported when it is used, since that takes half a second.
"""

from types import ModuleType

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.optim.box import Unbounded
from adhesion_jax.optim.least_squares import Residual, Result, finish


def levenberg_marquardt(
    residual: Residual,
    start: Float[Array, " p"],
    lower: Float[Array, " p"],
    upper: Float[Array, " p"],
    max_steps: int,
) -> Result:
    """Jaxopt's Levenberg-Marquardt, with the Jacobian materialised and a Cholesky solve."""
    space = Unbounded.around(start, lower, upper)
    solver = _jaxopt().LevenbergMarquardt(
        lambda u: residual(space.to_box(u)),
        maxiter=max_steps,
        stop_criterion="madsen-nielsen",
        xtol=1e-9,
        gtol=0.0,
        materialize_jac=True,
        solver="cholesky",
    )
    u, state = solver.run(space.from_box(start))
    return finish(residual, space.to_box(u), start, lower, upper, jnp.asarray(state.iter_num))


def gauss_newton(
    residual: Residual,
    start: Float[Array, " p"],
    lower: Float[Array, " p"],
    upper: Float[Array, " p"],
    max_steps: int,
) -> Result:
    """Jaxopt's Gauss-Newton: full steps, no safeguard."""
    space = Unbounded.around(start, lower, upper)
    solver = _jaxopt().GaussNewton(lambda u: residual(space.to_box(u)), maxiter=max_steps, tol=1e-9)
    u, state = solver.run(space.from_box(start))
    return finish(residual, space.to_box(u), start, lower, upper, jnp.asarray(state.iter_num))


def _jaxopt() -> ModuleType:
    with jax.ensure_compile_time_eval():  # its constants are no part of the program being traced
        import jaxopt
    return jaxopt
