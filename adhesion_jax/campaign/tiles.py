"""One tile of runs: the unit of work of a campaign, in whichever process it is done.

A tile is always computed whole, run number r in place r mod TILE: a matrix product rounds
differently in a batch of another size, and so the result of a run depends on its number alone,
not on how many runs, tiles at a time or workers there are.
"""

import time
from collections.abc import Callable, Iterable
from functools import cached_property
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Int, Key

from adhesion_jax import programs, runtime
from adhesion_jax.campaign.keys import keys_of_runs, noise_key, solver_key
from adhesion_jax.identifiers import Estimate, Identifier, follow
from adhesion_jax.identifiers.of_numpy import complain
from adhesion_jax.inference.curve_errors import cosine_errors
from adhesion_jax.metrics.tracking import Tracker, Tracking, criteria_of
from adhesion_jax.records import Record
from adhesion_jax.scenarios import Scenario

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


class Tiles:
    """The tiles of a scenario, whose programs are compiled or loaded once.

    Random keys depend on its name.
    """

    def __init__(self, name: str, scenario: Scenario) -> None:
        self.name, self.scenario = name, scenario
        self._content = content_of(scenario)
        self._programs: dict[object, tuple[_Program, float]] = {}

    def draw(self, seed: int, tile: int) -> Record:
        """The records of a tile: [runs, blocks, points], shared arrays [blocks, points]."""
        drawn: Record = self._draw((noise_key(seed, self.name), tile_runs(tile)))
        return drawn

    @cached_property
    def _draw(self) -> Callable[[_KeyAndRuns], Record]:
        scenario = self.scenario

        def draw(of: _KeyAndRuns) -> Record:
            return jax.vmap(scenario.draw, out_axes=scenario.run_axes)(keys_of_runs(*of))

        example = noise_key(0, self.name), tile_runs(0)
        return programs.program(("draw", self._content), draw, example)

    @cached_property
    def bound(self) -> Callable[[Record], Float[Array, "runs blocks values"]]:
        """The Cramer-Rao bound of every run and block of records of a tile."""
        axes = self.scenario.run_axes
        bound = jax.vmap(self.scenario.bound, in_axes=(axes,), axis_size=TILE)
        return programs.program(("bound", self._content), bound, self.draw(0, 0))

    @cached_property
    def cosine_errors(
        self,
    ) -> Callable[[tuple[Record, ArrayLike]], Float[Array, "runs blocks values"]]:
        """The `cosine_errors` of the curves with the least squares of the blocks of a tile.

        They take the records with the parameters, [runs, blocks, free].
        """
        known, axes = self.scenario.known, self.scenario.run_axes

        def errors(of_tile: tuple[Record, Array]) -> Array:
            # The axis of the blocks to the front: one after the other, they stay in the cache.
            blocks = jax.tree.map(lambda x: jnp.moveaxis(x, -2, 0), of_tile)
            found = jax.lax.map(lambda one: cosine_errors(known, one[0], axes, one[1]), blocks)
            return jnp.moveaxis(found, 0, 1)

        parameters = np.zeros((TILE, len(self.scenario.rails), len(known.curve.free)))
        name = ("errors by cosines", self._content)
        return programs.program(name, errors, (self.draw(0, 0), parameters), COMPILER)

    def identify(
        self, seed: int, tile: int, name: str, method: Identifier, records: Record
    ) -> TileResult:
        """The estimates of one identifier, by its name and itself, on the records of a tile."""
        records = jax.block_until_ready(records)
        key = solver_key(seed, self.name, name)
        compiled, compile_seconds = self._program(method)
        began = time.process_time()
        found = jax.block_until_ready(compiled(method, records, key, tile_runs(tile)))
        seconds = time.process_time() - began
        complain()
        estimate, tracking = jax.tree.map(np.asarray, found)
        return TileResult(estimate, tracking, seconds, compile_seconds)

    def make_ready(self, methods: Iterable[Identifier]) -> None:
        """The programs of `identify`, compiled side by side in the threads of this process."""
        with runtime.threads() as pool:
            list(pool.map(self._program, methods))

    def _program(self, method: Identifier) -> tuple[_Program, float]:
        """The function of all methods of one form, and the seconds to compile or load it.

        The identifier, whose numbers are of some kinds, is an argument, so that variants that
        differ in numbers alone share the function.
        """
        leaves, form = jax.tree.flatten(method)
        kinds = tuple(jax.typeof(jnp.asarray(leaf)) for leaf in leaves)
        if (form, kinds) not in self._programs:
            self._programs[form, kinds] = self._compiled(form, kinds)
        return self._programs[form, kinds]

    def _compiled(
        self, form: jax.tree_util.PyTreeDef, kinds: tuple[Any, ...]
    ) -> tuple[_Program, float]:
        scenario = self.scenario
        numbers = [jax.ShapeDtypeStruct(k.shape, k.dtype, weak_type=k.weak_type) for k in kinds]
        example = jax.tree.unflatten(form, numbers)
        given = (example, self.draw(0, 0), solver_key(0, self.name, ""), tile_runs(0))
        leaves, structure = jax.tree.flatten(given)
        mu_max = scenario.quantities().get("mu_max", np.full(len(scenario.rails), np.nan))

        def tile(leaves: list[Array]) -> tuple[Estimate, Tracking]:
            method, records, key, runs = jax.tree.unflatten(structure, leaves)
            keys = keys_of_runs(key, runs)
            criteria = criteria_of(scenario.known)
            tracker = Tracker.of(scenario.rails, mu_max, criteria, method.RESETS)
            in_axes = (None, None, scenario.run_axes, 0, None)
            return jax.vmap(follow, in_axes)(method, scenario.known, records, keys, tracker)

        name = ("tile", self._content, form, str(kinds))
        began = time.perf_counter()
        compiled = programs.program(name, tile, leaves, COMPILER)
        seconds = time.perf_counter() - began
        return lambda *arguments: compiled(jax.tree.leaves(arguments)), seconds


def content_of(scenario: Scenario) -> tuple[object, ...]:
    """The form and all numbers of a scenario: what two of them differ in, whatever their names."""
    leaves, form = jax.tree.flatten(scenario)
    numbers = map(np.asarray, leaves)
    return form, *((leaf.dtype.str, leaf.shape, leaf.tobytes()) for leaf in numbers)


#: The tiles that this process has used last, by the name and the content of the scenario.
_latest: dict[object, Tiles] = {}

#: As many as a command goes back and forth between.
_MOST = 8


def tiles_of(name: str, scenario: Scenario) -> Tiles:
    """The tiles of a scenario: a process that is given equal ones again and again has one."""
    known = name, *content_of(scenario)
    found = _latest.pop(known, None) or Tiles(name, scenario)
    _latest[known] = found  # the last in the order
    if len(_latest) > _MOST:
        del _latest[next(iter(_latest))]
    return found
