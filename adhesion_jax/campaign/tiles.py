"""One tile of runs: the unit of work of a campaign, in whichever process it is done.

A tile is always computed whole, run number r in place r mod TILE: a matrix product rounds
differently in a batch of another size, and so the result of a run depends on its number alone,
not on how many runs, tiles at a time or workers there are.
"""

import time
from collections.abc import Callable, Sequence
from functools import cache, lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Int, Key

from adhesion_jax import programs, runtime
from adhesion_jax.campaign.config import Config
from adhesion_jax.campaign.keys import keys_of_runs, noise_key, solver_key
from adhesion_jax.identifiers import Estimate, Identifier, follow
from adhesion_jax.metrics.tracking import Tracker, Tracking, criteria_of
from adhesion_jax.records import Record
from adhesion_jax.scenarios import Options, Scenario, build

TILE = 128

_Program = Callable[[Identifier, Record, Key[Array, ""], np.ndarray], tuple[Estimate, Tracking]]

_KeyAndRuns = tuple[Key[Array, ""], Int[ArrayLike, " runs"]]

#: The options of the compiler for the programs of all methods: the lowest optimisation level that
#: does not make them slower, and vectors of 512 bits. With these differential evolution is 1.5
#: times as fast, recursions and gradient solvers are 1.1 to 1.4 times as fast.
COMPILER: dict[str, str | bool] = {
    "xla_backend_optimization_level": "1",
    **programs.WIDELY,
    **programs.QUICKLY,
}


class TileResult(NamedTuple):
    """Estimates [runs, blocks] and what was seen on the way, as NumPy arrays."""

    estimate: Estimate
    tracking: Tracking
    seconds: float  # of the CPU
    #: By the clock, to compile or load the program in this process. Methods of one form share one,
    #: and each of them has its time.
    compile_seconds: float


def tile_runs(tile: int) -> np.ndarray:
    """The run numbers of a tile."""
    return np.arange(tile * TILE, (tile + 1) * TILE)


def draw_tile(config: Config, tile: int) -> Record:
    """The records of a tile: [runs, blocks, points], shared arrays [blocks, points]."""
    key = noise_key(config.seed, config.scenario)
    return _draw(config.scenario, config.options)((key, tile_runs(tile)))


def bound_tile(config: Config, records: Record) -> Float[Array, "runs blocks values"]:
    """The Cramer-Rao bound of every run and block."""
    return _bound(config.scenario, config.options)(records)


def identify_tile(config: Config, tile: int, name: str, method: Identifier) -> TileResult:
    """The estimates of one identifier, by its name and itself, on all the runs of a tile."""
    return identify_records(config, tile, name, method, draw_tile(config, tile))


def identify_records(
    config: Config, tile: int, name: str, method: Identifier, records: Record
) -> TileResult:
    """The same from the records of the tile."""
    records = jax.block_until_ready(records)
    key = solver_key(config.seed, config.scenario, name)
    compiled, compile_seconds = _program(config, method)
    began = time.process_time()
    found = jax.block_until_ready(compiled(method, records, key, tile_runs(tile)))
    seconds = time.process_time() - began
    estimate, tracking = jax.tree.map(np.asarray, found)
    return TileResult(estimate, tracking, seconds, compile_seconds)


def make_ready(config: Config, methods: Sequence[Identifier]) -> None:
    """The programs of `identify_tile`, compiled side by side in the threads of this process."""
    with runtime.threads() as pool:
        list(pool.map(lambda method: _program(config, method), methods))


def _program(config: Config, method: Identifier) -> tuple[_Program, float]:
    leaves, form = jax.tree.flatten(method)
    kinds = tuple(jax.typeof(jnp.asarray(leaf)) for leaf in leaves)
    return _compiled(config.scenario, config.options, form, kinds)


@lru_cache
def scenario_of(name: str, options: Options) -> Scenario:
    """The scenario of this name with these options, built once in a process."""
    return build(name, options)


@lru_cache
def _draw(scenario_name: str, options: Options) -> Callable[[_KeyAndRuns], Record]:
    scenario = scenario_of(scenario_name, options)

    def draw(of: _KeyAndRuns) -> Record:
        return jax.vmap(scenario.draw, out_axes=scenario.run_axes)(keys_of_runs(*of))

    example = noise_key(0, scenario_name), tile_runs(0)
    return programs.program(("draw", scenario_name, options), draw, example)


@lru_cache
def _bound(
    scenario_name: str, options: Options
) -> Callable[[Record], Float[Array, "runs blocks values"]]:
    scenario = scenario_of(scenario_name, options)
    records = draw_tile(Config(scenario_name, options=options), 0)
    bound = jax.vmap(scenario.bound, in_axes=(scenario.run_axes,), axis_size=TILE)
    return programs.program(("bound", scenario_name, options), bound, records)


@cache
def _compiled(
    scenario_name: str,
    options: Options,
    form: jax.tree_util.PyTreeDef,
    kinds: tuple[Any, ...],
) -> tuple[_Program, float]:
    """The compiled function of all methods of one form, and the seconds to compile or load it.

    The identifier, whose numbers are of these kinds, is an argument, so that variants that differ
    in numbers alone share the function.
    """
    scenario = scenario_of(scenario_name, options)
    key = solver_key(0, scenario_name, "")
    numbers = [jax.ShapeDtypeStruct(k.shape, k.dtype, weak_type=k.weak_type) for k in kinds]
    records = draw_tile(Config(scenario=scenario_name, options=options), 0)
    example = jax.tree.unflatten(form, numbers)
    leaves, structure = jax.tree.flatten((example, records, key, tile_runs(0)))
    mu_max = scenario.quantities().get("mu_max", np.full(len(scenario.rails), np.nan))

    def tile(leaves: list[Array]) -> tuple[Estimate, Tracking]:
        method, records, key, runs = jax.tree.unflatten(structure, leaves)
        keys = keys_of_runs(key, runs)
        tracker = Tracker.of(scenario.rails, mu_max, criteria_of(scenario.known), method.RESETS)
        in_axes = (None, None, scenario.run_axes, 0, None)
        return jax.vmap(follow, in_axes)(method, scenario.known, records, keys, tracker)

    name = ("tile", scenario_name, options, form, str(kinds))
    began = time.perf_counter()
    compiled = programs.program(name, tile, leaves, COMPILER)
    seconds = time.perf_counter() - began
    return lambda *arguments: compiled(jax.tree.leaves(arguments)), seconds
