"""`sample`: what an identifier takes, from numbers."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.records import Record
from adhesion_jax.runtime import require_double_precision


def sample(
    slip: float | Float[Array, "..."],
    adhesion: float | Float[Array, "..."],
    **conditions: float | Float[Array, "..."],
) -> Record:
    """One fresh sample, or arrays [points] of a block, as `update` of an identifier takes it.

    May be used within `jax.jit` and `jax.vmap`.

    Args:
        slip: a ratio, or ratios [points].
        adhesion: force over load, of the same shape.
        **conditions: columns in SI units, such as time_s or vehicle_speed_mps.

    Returns:
        The record, all of whose points are new.

    Raises:
        InputError: jax computes in single precision.
    """
    require_double_precision()
    slips = jnp.atleast_1d(jnp.asarray(slip, float))

    def like_slips(values: float | Float[Array, "..."]) -> Float[Array, " points"]:
        return jnp.broadcast_to(jnp.asarray(values, float), slips.shape)

    every = jnp.ones(slips.shape, dtype=bool)
    columns = {name: like_slips(values) for name, values in conditions.items()}
    return Record(slips, like_slips(adhesion), every, every, columns)
