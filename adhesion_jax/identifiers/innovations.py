"""What standardised innovations tell: the scale of the noise, and that the rail has changed."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from adhesion_jax.curves import Scalar
from adhesion_jax.optim.arrays import Count, Value, Whether

#: (votes, samples, limit): a reset takes this many of this many latest samples whose innovation
#: exceeds this many of its standard deviations. The first rule finds a switch, the second one that
#: is too small for the first. With Gaussian noise either rule holds less than once in 10^9 samples;
#: with three per cent of outliers ten times as wide the first one holds twice in 10^6.
FAST, SLOW = (4, 5, 3.0), (8, 10, 2.2)

#: Median of |n| for a standard Gaussian n.
MEDIAN = 0.6745

#: Step of the recursion for the logarithm of that median, of least variance: 1/(density of log |n|
#: at the median).
STEP = 2.333

#: Least standard deviation of the noise, finer than any sensor of adhesion: data without noise
#: would otherwise bring the scale to zero, and residuals are divided by it.
FINEST = 1e-9


def votes(surprise: Float[Array, " length"]) -> tuple[Bool[Array, " length"], Whether]:
    """The samples that vote, and whether by one of the rules they are enough for a reset.

    `surprise` is |nu| of the latest samples, the latest first, and 0 where a sample has no vote.
    """
    place = jnp.arange(surprise.size)
    fast, slow = ((place < last) & (surprise > limit) for _, last, limit in (FAST, SLOW))
    is_fast, is_slow = jnp.sum(fast) >= FAST[0], jnp.sum(slow) >= SLOW[0]
    return jnp.where(is_fast, fast, slow), is_fast | is_slow


def followed_scale(scale: Value, nu: Value, samples: Count, least: Scalar) -> Value:
    """The standard deviation of the noise after one more sample; the gain is `least` or more."""
    step = jnp.maximum(STEP / samples, least)
    factor = jnp.exp(step * jnp.where(jnp.abs(nu) > MEDIAN, 0.5, -0.5))
    return jnp.maximum(scale * factor, FINEST)


def huber_weight(nu: Float[Array, "*points"], huber: Scalar) -> Float[Array, "*points"]:
    """min(1, huber/|nu|)."""
    return jnp.where(jnp.abs(nu) > huber, huber / jnp.abs(nu), 1.0)
