"""Random keys of a run: a function of seed, scenario and run number alone."""

from functools import lru_cache
from zlib import crc32

import jax
from jaxtyping import Array, ArrayLike, Int, Key

from adhesion_jax.programs import kept


def noise_keys(seed: int, scenario: str, runs: Int[Array, " runs"]) -> Key[Array, " runs"]:
    """A key for the data of each run: every identifier sees the same noise."""
    keys: Key[Array, " runs"] = _of_runs(noise_key(seed, scenario), runs)
    return keys


def solver_keys(
    seed: int, scenario: str, identifier: str, runs: Int[Array, " runs"]
) -> Key[Array, " runs"]:
    """A key for each run for an identifier's own randomness."""
    keys: Key[Array, " runs"] = _of_runs(solver_key(seed, scenario, identifier), runs)
    return keys


def noise_key(seed: int, scenario: str) -> Key[Array, ""]:
    """What `keys_of_runs` makes `noise_keys` of, within a program."""
    return _of_words(seed, (scenario, "noise"))


def solver_key(seed: int, scenario: str, identifier: str) -> Key[Array, ""]:
    """What `keys_of_runs` makes `solver_keys` of, within a program."""
    return _of_words(seed, (scenario, "solver", identifier))


def keys_of_runs(key: Key[Array, ""], runs: Int[ArrayLike, " runs"]) -> Key[Array, " runs"]:
    return jax.vmap(lambda run: jax.random.fold_in(key, run))(runs)


_of_runs = kept()(keys_of_runs)


@lru_cache
def _of_words(seed: int, words: tuple[str, ...]) -> Key[Array, ""]:
    with jax.ensure_compile_time_eval():  # it is kept, and so must not be a part of a program
        key = jax.random.key(seed)
        for word in words:
            key = jax.random.fold_in(key, crc32(word.encode()))
        return key
