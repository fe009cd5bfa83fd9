"""Identifications of a batch of runs of any size, on any processor."""

import time
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Key

from adhesion_jax.campaign.job import Config, build_scenario
from adhesion_jax.campaign.keys import noise_keys, solver_keys
from adhesion_jax.campaign.tiles import COMPILER
from adhesion_jax.identifiers import IDENTIFIERS, Estimate, identify
from adhesion_jax.records import Record


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
