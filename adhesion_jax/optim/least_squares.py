"""The contract of a gradient solver of least squares."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
from jax.extend.core import ClosedJaxpr, jaxpr_as_fun
from jaxtyping import Array, Float

from adhesion_jax.optim.arrays import Count, Matrix, Value, Vector, Whether

Residual = Callable[[Vector], Float[Array, " n"]]


class Result(NamedTuple):
    x: Vector
    objective: Value  # sum of squares
    information: Matrix  # J'J, J the Jacobian of the residual
    steps: Count
    evaluations: Count  # of the residual; a Jacobian counts as p evaluations
    converged: Whether


#: (residual, start, lower, upper, max_steps) to the result.
Solver = Callable[[Residual, Vector, Vector, Vector, int], Result]


def separated(
    residual: Residual, start: Vector
) -> tuple[Callable[[list[Any], Vector], Float[Array, " n"]], list[Any]]:
    """The residual as a function of x and of the arrays that it takes from around it, and those.

    A batching rule is told of arguments alone which of them differ from problem to problem.
    """
    traced = jax.make_jaxpr(residual)(start)

    def value(data: list[Any], x: Vector) -> Float[Array, " n"]:
        found: Array = jaxpr_as_fun(ClosedJaxpr(traced.jaxpr, data))(x)[0]
        return found

    return value, traced.consts
