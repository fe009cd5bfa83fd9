"""Differential evolution on the sum of squares over all points of a record.

The identifiers reduce a record to a few sums first. Without that, nearly all of the time goes into
exponentials.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float, Key

from adhesion_jax.campaign.tiles import COMPILER
from adhesion_jax.identifiers.ml_de import CROSSOVER
from adhesion_jax.optim import differential_evolution as de

#: Its scale factor, that of `ml-de`.
SCALE = 0.5

#: Points whose squares are summed in one loop over members and runs: 5 and 25 are not faster.
_TOGETHER = 10

#: Whatever the flags of the environment.
_COMPILER = {**COMPILER, "xla_cpu_use_fusion_emitters": True}

_Search = Callable[[Key[Array, " runs"], Float[Array, "runs points"]], Float[Array, "runs 3"]]


def search(
    slip: Float[Array, " points"],
    box: tuple[Float[ArrayLike, "3"], Float[ArrayLike, "3"]],
    runs: int,
    members: int,
    generations: int,
) -> _Search:
    """The compiled search of many runs on common slips, with all its generations."""
    lower, upper = map(jnp.asarray, box)
    settings = de.Settings(SCALE, CROSSOVER, reflect=False, tolerance=-1.0)

    def one(key: Key[Array, ""], adhesion: Float[Array, " points"]) -> Float[Array, "3"]:
        def sum_of_squares(x: Float[Array, "3"]) -> Float[Array, ""]:
            c1, c2, c3 = x

            def add(total: Array, point: tuple[Array, Array]) -> tuple[Array, None]:
                slip, adhesion = point
                left = c1 * (1 - jnp.exp(-c2 * slip)) - c3 * slip - adhesion
                return total + left**2, None

            # One point after the other, for members and runs side by side: a sum over points for
            # each of them takes three times as long.
            points = slip, adhesion
            return jax.lax.scan(add, jnp.zeros(()), points, unroll=_TOGETHER)[0]

        first, rest = jax.random.split(key)
        share = jax.random.uniform(first, (lower.size, members))
        population = lower[:, None] + (upper - lower)[:, None] * share
        found = de.minimise(sum_of_squares, population, lower, upper, rest, settings, generations)
        return found.x

    keys = jax.random.split(jax.random.key(0), runs)
    blocks = jax.ShapeDtypeStruct((runs, slip.size), slip.dtype)
    found: _Search = jax.jit(jax.vmap(one)).lower(keys, blocks).compile(_COMPILER)
    return found
