"""Random keys of a run: a function of seed, scenario and run number alone."""

from functools import lru_cache
from zlib import crc32

import jax
from jaxtyping import Array, Int, Key

from adhesion_jax.programs import kept


def noise_keys(seed: int, scenario: str, runs: Int[Array, " runs"]) -> Key[Array, " runs"]:
    """A key for the data of each run: every identifier sees the same noise."""
    return _keys(seed, (scenario, "noise"), runs)


def solver_keys(
    seed: int, scenario: str, identifier: str, runs: Int[Array, " runs"]
) -> Key[Array, " runs"]:
    """A key for each run for an identifier's own randomness."""
    return _keys(seed, (scenario, "solver", identifier), runs)


def _keys(seed: int, words: tuple[str, ...], runs: Int[Array, " runs"]) -> Key[Array, " runs"]:
    keys: Key[Array, " runs"] = _of_runs(_of_words(seed, words), runs)
    return keys


@lru_cache
def _of_words(seed: int, words: tuple[str, ...]) -> Key[Array, ""]:
    with jax.ensure_compile_time_eval():  # it is kept, and so must not be a part of a program
        key = jax.random.key(seed)
        for word in words:
            key = jax.random.fold_in(key, crc32(word.encode()))
        return key


@kept()
def _of_runs(key: Key[Array, ""], runs: Int[Array, " runs"]) -> Key[Array, " runs"]:
    return jax.vmap(lambda run: jax.random.fold_in(key, run))(runs)
