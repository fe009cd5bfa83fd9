"""Steps of a plant in time."""

from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

S = TypeVar("S")

#: RK4 is stable on the negative real axis down to this product of rate and step.
RK4_STABLE = 2.785


def rk4(derivative: Callable[[S], S], state: S, step: Float[Array, ""] | float) -> S:
    """One step of the classical Runge-Kutta method of fourth order."""

    def moved(slope: S, share: float) -> S:
        return jax.tree.map(lambda one, rate: one + share * step * rate, state, slope)

    first = derivative(state)
    second = derivative(moved(first, 0.5))
    third = derivative(moved(second, 0.5))
    fourth = derivative(moved(third, 1.0))
    return jax.tree.map(
        lambda one, a, b, c, d: one + step / 6 * (a + 2 * (b + c) + d),
        state,
        first,
        second,
        third,
        fourth,
    )


def rates(derivative: Callable[[S], S], state: S) -> np.ndarray:
    """The eigenvalues of a plant linearised about a state, in 1/s."""
    flat, whole = ravel_pytree(state)

    def flattened(values: Array) -> Array:
        return ravel_pytree(derivative(whole(values)))[0]

    return np.linalg.eigvals(np.asarray(jax.jacfwd(flattened)(jnp.asarray(flat))))


def largest_step(derivative: Callable[[S], S], state: S) -> float:
    """The step of RK4 in seconds that the fastest decaying mode about a state allows."""
    fastest = float(np.max(-rates(derivative, state).real))
    return RK4_STABLE / fastest if fastest > 0 else np.inf
