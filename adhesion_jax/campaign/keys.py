"""Random keys of a run: a function of seed, scenario and run number alone."""

from zlib import crc32

import jax
from jaxtyping import Array, Int, Key


def noise_keys(seed: int, scenario: str, runs: Int[Array, " runs"]) -> Key[Array, " runs"]:
    """A key for the data of each run: every identifier sees the same noise."""
    return _keys(seed, (scenario, "noise"), runs)


def solver_keys(
    seed: int, scenario: str, identifier: str, runs: Int[Array, " runs"]
) -> Key[Array, " runs"]:
    """A key for each run for an identifier's own randomness."""
    return _keys(seed, (scenario, "solver", identifier), runs)


def _keys(seed: int, words: tuple[str, ...], runs: Int[Array, " runs"]) -> Key[Array, " runs"]:
    key = jax.random.key(seed)
    for word in words:
        key = jax.random.fold_in(key, crc32(word.encode()))
    return jax.vmap(lambda run: jax.random.fold_in(key, run))(runs)
