"""Random numbers from a counter, for the inner loop of a population method.

A threefry draw costs several times a generation of differential evolution on a small problem.
Here a 32-bit integer hash (two rounds of xor-shift and odd multiplication, constants of
C. Wellons' `lowbias32`) of seed, time, purpose and member gives each number, without state.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, UInt32


def _mix(word: UInt32[Array, "*shape"]) -> UInt32[Array, "*shape"]:
    word = (word ^ (word >> 16)) * jnp.uint32(0x7FEB352D)
    word = (word ^ (word >> 15)) * jnp.uint32(0x846CA68B)
    return word ^ (word >> 16)


def counter_bits(
    seed: UInt32[Array, "2 ..."],
    time: Int[Array, "..."],
    purpose: int | Int[np.ndarray, " purposes"],
    members: int,
) -> UInt32[Array, "..."]:
    """32 random bits, [purposes, members, runs]: a function of the arguments alone.

    A single purpose or run has no axis.
    """
    one_run = [1] * time.ndim
    step = np.asarray(purpose, np.uint64) * np.uint64(0x9E3779B9) % 2**32
    step = step.astype(np.uint32).reshape(*step.shape, 1, *one_run)
    member = np.arange(members, dtype=np.uint32).reshape(members, *one_run)
    stream = _mix(seed[0] ^ _mix(time.astype(jnp.uint32) + step))
    return _mix(_mix(stream + member) ^ seed[1])


def as_uniform(bits: UInt32[Array, "*shape"]) -> Float[Array, "*shape"]:
    """Uniform numbers in [0, 1)."""
    return bits.astype(jnp.float64) * 2.0**-32


def as_integer(bits: UInt32[Array, "*shape"], bound: int) -> Int[Array, "*shape"]:
    """Uniform integers in [0, bound), bound < 2^16 (bias below bound/2^16)."""
    return ((bits >> 16) * jnp.uint32(bound) >> 16).astype(jnp.int32)
