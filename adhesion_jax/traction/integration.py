"""Steps of a plant in time."""

from collections.abc import Callable
from typing import TypeVar

import jax
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

S = TypeVar("S")

#: RK4 is stable on the negative real axis down to this product of rate and step.
RK4_STABLE = 2.785


def rk4(derivative: Callable[[S], S], state: S, step: Float[Array, ""] | float) -> S:
    """One step of the classical Runge-Kutta method of fourth order."""

    def moved(slope: S, share: float) -> S:
        return jax.tree.map(lambda one, rate: one + share * step * rate, state, slope)

    traced = jax.jit(derivative)  # traced once, not four times
    first = traced(state)
    second = traced(moved(first, 0.5))
    third = traced(moved(second, 0.5))
    fourth = traced(moved(third, 1.0))
    return jax.tree.map(
        lambda one, a, b, c, d: one + step / 6 * (a + 2 * (b + c) + d),
        state,
        first,
        second,
        third,
        fourth,
    )


def jacobian(derivative: Callable[[S], S], state: S) -> Float[Array, "numbers numbers"]:
    """A of d x/dt = A x for small x off a state; its eigenvalues are the rates of the plant in 1/s.

    The numbers of the state are in the order of its leaves.
    """
    flat, whole = ravel_pytree(state)

    def flattened(values: Float[Array, " numbers"]) -> Float[Array, " numbers"]:
        return ravel_pytree(derivative(whole(values)))[0]

    return jax.jacfwd(flattened)(flat)
