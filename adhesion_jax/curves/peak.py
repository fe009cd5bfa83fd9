"""The peak of a law, and how it is found where there is no closed form for it."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

_GRID = 512
_BISECTIONS = 40


class Peak(NamedTuple):
    """The largest adhesion for slips between 0 and a limit.

    `found` is false where adhesion has no maximum inside that range; `slip` and `adhesion` are
    then those of the end of the range where adhesion is largest, so they are always finite.
    """

    slip: Float[Array, "..."]
    adhesion: Float[Array, "..."]
    found: Bool[Array, "..."]


def find_peak(
    adhesion: Callable[[Float[Array, "..."]], Float[Array, "..."]],
    slip_limit: float | Float[Array, ""],
) -> Peak:
    """Largest value of `adhesion(slip)` for 0 <= slip <= slip_limit.

    A logarithmic grid brackets the maximum, the derivative is bisected inside the bracket, and
    one Newton step at the end makes the answer differentiable in the law's parameters (by the
    implicit function theorem: d slip/d theta = -(d2 mu/d slip d theta)/(d2 mu/d slip2)).
    """
    limit = jnp.asarray(slip_limit, dtype=float)
    slope = jax.grad(lambda slip: adhesion(slip))
    grid = limit * jnp.concatenate([jnp.zeros(1), jnp.geomspace(1e-6, 1.0, _GRID)])
    best = jnp.argmax(adhesion(grid))
    inside = (best > 0) & (best < _GRID)
    bracket = (grid[jnp.maximum(best - 1, 0)], grid[jnp.minimum(best + 1, _GRID)])

    def bisect(_: Int[Array, ""], ends: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high = ends
        middle = 0.5 * (low + high)
        rising = slope(middle) > 0
        return jnp.where(rising, middle, low), jnp.where(rising, high, middle)

    low, high = jax.lax.stop_gradient(jax.lax.fori_loop(0, _BISECTIONS, bisect, bracket))
    middle = 0.5 * (low + high)
    # The peak may also lie in the last cell of the grid, where the end is the largest node.
    found = inside | ((best == _GRID) & (slope(limit) < 0))
    curvature = jax.lax.stop_gradient(jax.grad(slope)(middle))
    at_maximum = found & (curvature < 0)
    step = jnp.where(at_maximum, slope(middle) / jnp.where(at_maximum, curvature, -1.0), 0.0)
    slip = jnp.where(found, jnp.clip(middle - step, low, high), grid[best])
    return Peak(slip, adhesion(slip), found)
