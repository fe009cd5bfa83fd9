"""A curve that may bend: the form of a name, times a smooth departure from it."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from adhesion_jax.curves.base import NO_CONDITIONS, Conditions, Curve, Law, Scalar, Signal
from adhesion_jax.curves.precision import precise_of_numbers

#: Number of functions that the departure of a single curve is made of: of ten a kink at the peak
#: was missed, of more than 24 nothing was gained. Below effects, where they must be fitted many
#: times, 16 keep a column from being named for what the curve could not follow.
FUNCTIONS, BELOW_EFFECTS = 24, 16


class Bent(Law):
    """mu(l) = m(l) (1 + d(l)), m the curve and d its departure from the points, a share of it.

    d(l) = sum_j factors_j sin(pi (j - 1/2) u), u = log(1 + |l|/reach) / log(1 + largest/reach): it
    is 0 at slip 0 and, beyond the largest slip of the points, what it is there. Without factors it
    is the curve itself. At negative slips the factors of `braking`, if there are any, are added.
    """

    curve: Curve
    factors: Float[Array | np.ndarray, " functions"]
    reach: Scalar  # the slip below which the functions are straight rather than logarithmic
    largest: Scalar
    braking: Float[Array | np.ndarray, " functions"] | None = None

    @precise_of_numbers
    def __call__(self, slip: Signal, conditions: Conditions = NO_CONDITIONS) -> Signal:
        return self.curve(slip, conditions) * (1 + self.departure(slip))

    def departure(self, slip: Float[ArrayLike, "*shape"]) -> Float[Array, "*shape"]:
        """D at these slips."""
        shape = functions(slip, self.reach, self.largest, len(self.factors))
        departure = shape @ jnp.asarray(self.factors)
        if self.braking is None:
            return departure
        apart = jnp.where(jnp.asarray(slip) < 0, shape @ jnp.asarray(self.braking), 0.0)
        return departure + apart


def functions(
    slip: Float[ArrayLike, "*shape"], reach: Scalar, largest: Scalar, count: int = FUNCTIONS
) -> Float[Array, "*shape functions"]:
    """The first `count` functions of a departure at these slips."""
    place = place_of(slip, reach, largest)
    return jnp.sin(jnp.pi * (jnp.arange(count) + 0.5) * place[..., None])


def place_of(
    slip: Float[ArrayLike, "*shape"], reach: Scalar, largest: Scalar
) -> Float[Array, "*shape"]:
    """The place u of these slips, from 0 to 1."""
    size = jnp.minimum(jnp.abs(slip), largest)
    return jnp.log1p(size / reach) / jnp.log1p(largest / reach)
