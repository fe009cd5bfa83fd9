"""Functions of single runs, computed tile by tile as in a campaign."""

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from adhesion_jax.campaign.tiles import TILE, tile_runs


def over_runs(
    runs: int,
    compute: Callable[[Int[Array, " runs"]], Float[Array, "..."] | Int[Array, "..."]],
    advance: Callable[[], None],
) -> np.ndarray:
    """`compute` of the run numbers of each tile, joined; `advance` is called after each tile."""
    parts = []
    for number in range(-(-runs // TILE)):
        parts.append(np.asarray(compute(jnp.asarray(tile_runs(number)))))
        advance()
    return np.concatenate(parts)[:runs]
