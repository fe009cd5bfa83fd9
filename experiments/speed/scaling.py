"""How the rate changes with the number of runs, of points, of members and of cores."""

import time
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import pandas as pd
from jaxtyping import Array, Key

from adhesion_jax import runtime
from adhesion_jax.campaign.job import Config, build_scenario
from adhesion_jax.campaign.keys import noise_keys, solver_keys
from adhesion_jax.campaign.tiles import COMPILER
from adhesion_jax.identifiers import IDENTIFIERS, Estimate, identify
from adhesion_jax.records import Record
from adhesion_jax.scenarios import Options
from experiments.speed.blocks import search_of_all_points
from experiments.speed.turns import Timed, rates, timed

#: The methods whose rates are followed.
METHODS = ("ml-exact", "lm")

RUN_COUNTS: Sequence[int] = (1, 16, 128, 512)
POINT_COUNTS: Sequence[int] = (125, 500, 2000)
MEMBER_COUNTS: Sequence[int] = (10, 20, 40, 80)

#: Generations of differential evolution, on the uncompressed sum of squares.
_GENERATIONS = 50

_RUNS, _POINTS = 128, 500


def drawn(config: Config) -> Record:
    """The records of all runs of a scenario, side by side: [runs, blocks, points]."""
    scenario = build_scenario(config)
    keys = noise_keys(config.seed, config.scenario, jnp.arange(config.runs))
    draw: Callable[[Key[Array, " runs"]], Record] = jax.jit(
        jax.vmap(scenario.draw, out_axes=scenario.run_axes)
    )
    return draw(keys)


class Batch(NamedTuple):
    """What identifies all runs by one method, compiled, and the CPU-seconds to compile it."""

    run: Callable[[], Estimate]
    compile_seconds: float


def batch_on(device: jax.Device, config: Config, name: str) -> Batch:
    """All runs of a scenario for one method on this device, with the noise drawn."""
    scenario, method = build_scenario(config), IDENTIFIERS[name]
    keys = solver_keys(config.seed, config.scenario, name, jnp.arange(config.runs))
    given = jax.device_put((drawn(config), keys), device)
    many = jax.vmap(identify, in_axes=(None, None, scenario.run_axes, 0))
    program = jax.jit(lambda records, keys: many(method, scenario.known, records, keys))
    began = time.process_time()
    options = COMPILER if device.platform == "cpu" else None
    ready = program.lower(*given).compile(options)
    seconds = time.process_time() - began
    return Batch(lambda: jax.block_until_ready(ready(*given)), seconds)


def sizes() -> list[tuple[str, int]]:
    """What is varied, with each of its values, in the order in which they are timed."""
    return [
        *(("runs", runs) for runs in RUN_COUNTS),
        *(("points", points) for points in POINT_COUNTS),
        *(("members", members) for members in MEMBER_COUNTS),
    ]


def table(turns: int, seed: int, progress: Callable[[str], None]) -> pd.DataFrame:
    """A row for each size and method, with the column `size`."""
    return pd.concat(_rows(turns, seed, progress), ignore_index=True)


def _rows(turns: int, seed: int, progress: Callable[[str], None]) -> Iterator[pd.DataFrame]:
    for along, value in sizes():
        if along == "members":
            works = {"differential evolution": _evolution(value, seed)}
        else:
            runs, points = (value, _POINTS) if along == "runs" else (_RUNS, value)
            works = {name: _identified(name, runs, points, seed) for name in METHODS}
        found = rates(f"scaling over {along}", "identifications", "", works, turns, lambda _: None)
        found["size"] = value
        progress(f"{value} {along}")
        yield found


def _config(runs: int, points: int, seed: int) -> Config:
    return Config("single", options=Options(points=points), runs=runs, seed=seed)


def _identified(name: str, runs: int, points: int, seed: int) -> Timed:
    batch = batch_on(runtime.device(), _config(runs, points, seed), name)
    return Timed(timed(batch.run, runs), "", batch.compile_seconds)


def _evolution(members: int, seed: int) -> Timed:
    """Differential evolution over all points, a fixed number of generations."""
    config = _config(_RUNS, _POINTS, seed)
    known, records = build_scenario(config).known, drawn(config)
    box = known.lower, known.upper
    ready = search_of_all_points(records.slip[0], box, _RUNS, members, _GENERATIONS)
    keys, blocks = jax.random.split(jax.random.key(seed), _RUNS), records.adhesion[:, 0]
    return Timed(timed(lambda: jax.block_until_ready(ready(keys, blocks)), _RUNS))
