"""Boxes: lower <= x <= upper, either end possibly infinite."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from adhesion_jax.optim.arrays import Vector

#: An estimate lies on the box if it is nearer to a bound than this share of the box's width.
_ON_BOX = 1e-4

# The sine has no slope on a bound: a start there could never leave it.
_START_MARGIN = 1e-3


def on_bound(
    x: Float[Any, "*batch p"], lower: Float[Any, " p"], upper: Float[Any, " p"]
) -> Bool[Any, "*batch p"]:
    """Which coordinates lie on the box; a bound at infinity is never reached.

    Computed by NumPy where all are arrays of NumPy, else by JAX.
    """
    library = np if isinstance(x, np.ndarray) else jnp
    margin = library.where(library.isfinite(upper - lower), _ON_BOX * (upper - lower), 0.0)
    return (x <= lower + margin) | (x >= upper - margin)


class Unbounded(NamedTuple):
    """Coordinates without bounds, for a solver that has no bounds.

    x = lower + (upper - lower)(1 + sin u)/2 where both ends are finite (the transformation of
    MINUIT), x = scale u elsewhere, the scale being the size of the start.
    """

    lower: Vector
    width: Vector
    bounded: Bool[Array, " p"]
    scale: Vector

    @staticmethod
    def around(start: Vector, lower: Vector, upper: Vector) -> "Unbounded":
        bounded = jnp.isfinite(lower) & jnp.isfinite(upper)
        return Unbounded(
            jnp.where(bounded, lower, 0.0),
            jnp.where(bounded, upper - lower, 1.0),
            bounded,
            jnp.where(start == 0, 1.0, jnp.abs(start)),
        )

    def to_box(self, u: Vector) -> Vector:
        inside = self.lower + self.width * 0.5 * (1 + jnp.sin(u))
        return jnp.where(self.bounded, inside, self.scale * u)

    def from_box(self, x: Vector) -> Vector:
        """x, moved inside the box if it lies on or beyond a bound."""
        share = jnp.clip((x - self.lower) / self.width, _START_MARGIN, 1 - _START_MARGIN)
        return jnp.where(self.bounded, jnp.arcsin(2 * share - 1), x / self.scale)


class Logit(NamedTuple):
    """Coordinates in which a box with finite ends has no ends: log((x - lower)/(upper - x)).

    Far from the upper end a step of a coordinate is a share of x - lower.
    """

    lower: Vector
    upper: Vector

    def to_box(self, u: Vector) -> Vector:
        return self.lower + (self.upper - self.lower) * jax.nn.sigmoid(u)

    def from_box(self, x: Vector) -> Vector:
        """x, moved inside the box if it lies on or beyond a bound."""
        share = (x - self.lower) / (self.upper - self.lower)
        share = jnp.clip(share, _ON_BOX, 1 - _ON_BOX)
        return jnp.log(share / (1 - share))

    def slope(self, u: Vector) -> Vector:
        """The derivative of x by u."""
        share = jax.nn.sigmoid(u)
        return (self.upper - self.lower) * share * (1 - share)
