"""What a campaign computes: a configuration, its methods, and how its runs are divided.

A shard is a number of runs of all methods, the unit that is computed by one process and that is
stored or not. The first shards are small, so that few runs are shared among processes, too; the
later ones are large, so that millions of runs need few of them. Which runs a shard has depends on
its number alone.
"""

from collections.abc import Mapping
from hashlib import sha256
from importlib.metadata import version
from itertools import pairwise
from typing import NamedTuple

import jax
import numpy as np

from adhesion_jax import keeping, programs, runtime
from adhesion_jax.campaign.config import Config, choose_identifiers
from adhesion_jax.campaign.tiles import TILE, scenario_of
from adhesion_jax.identifiers import IDENTIFIERS, Identifier
from adhesion_jax.scenarios import Group, Scenario

#: The method with whose objective every other is compared.
REFERENCE = "ml-exact"

#: So many shards have one tile, as many have two, then four, up to the largest.
_ALIKE = 16
_LARGEST = 32

#: Blocks after a switch whose estimates are kept for every run.
_AFTER_SWITCH = 5


class Row(NamedTuple):
    """The table and the row to which some statistics belong."""

    table: str
    group: Group
    identifier: str


class Job(NamedTuple):
    """A configuration and its methods by name, of which `names` are reported."""

    config: Config
    methods: Mapping[str, Identifier]
    names: tuple[str, ...]
    every_block: bool  # whether the estimates of all blocks are kept, or of a few

    @staticmethod
    def of(
        config: Config,
        identifiers: Mapping[str, Identifier] = IDENTIFIERS,
        every_block: bool = True,
    ) -> "Job":
        """With the methods of these names; the reference is among them if it fits the scenario."""
        scenario = scenario_of(config.scenario, config.options)
        names = choose_identifiers(config, scenario, identifiers)
        reference = identifiers.get(REFERENCE)
        fits = reference is not None and reference.accepts(scenario.known) is None
        wanted = dict.fromkeys((*([REFERENCE] if fits else []), *names))
        return Job(config, {name: identifiers[name] for name in wanted}, names, every_block)

    @property
    def scenario(self) -> Scenario:
        return scenario_of(self.config.scenario, self.config.options)

    @property
    def rows(self) -> list[Row]:
        """The rows of all tables of accuracy, in their order."""
        return [
            Row(table, group, name)
            for table, groups in self.scenario.tables().items()
            for name in self.names
            for group in groups
        ]

    @property
    def counted(self) -> tuple[str, ...]:
        """The quantities whose estimates are counted after every block."""
        share = ("forgetting",) if self.scenario.known.by_sample else ()
        return (*self.scenario.quantities(), *share)

    @property
    def stretches(self) -> tuple[str, ...]:
        """The rail of each part of a run on one rail."""
        rails = self.scenario.rails
        return tuple(rail for b, rail in enumerate(rails) if rail != (None, *rails)[b])

    @property
    def longest(self) -> int:
        """The number of steps of a method on the longest stretch."""
        scenario = self.scenario
        starts = [b for b, (old, new) in enumerate(pairwise(scenario.rails), 1) if old != new]
        blocks = int(np.max(np.diff([0, *starts, len(scenario.rails)])))
        if not scenario.known.by_sample:
            return blocks
        return blocks * int(jax.eval_shape(scenario.draw, jax.random.key(0)).mask.shape[-1])

    @property
    def kept_blocks(self) -> np.ndarray:
        """The blocks whose estimates are kept for every run.

        All, or the last before and the first five after each switch, and the last.
        """
        rails = self.scenario.rails
        if self.every_block:
            return np.arange(len(rails))
        starts = [b for b, (old, new) in enumerate(pairwise(rails), 1) if old != new]
        near = {b + j for b in starts for j in range(-1, _AFTER_SWITCH)}
        return np.array(sorted(b for b in near | {len(rails) - 1} if b < len(rails)))


def shard_tiles(number: int) -> range:
    """The tiles of the shard of this number."""
    size, first = 1, 0
    while size < _LARGEST and number >= _ALIKE:
        first, number, size = first + _ALIKE * size, number - _ALIKE, 2 * size
    return range(first + number * size, first + (number + 1) * size)


def shard_runs(job: Job, number: int) -> int:
    """The number of runs of a shard: the last one has what remains."""
    tiles = shard_tiles(number)
    return min(tiles.stop * TILE, job.config.runs) - tiles.start * TILE


def shard_count(job: Job) -> int:
    """The number of shards that have all the runs of a job."""
    number = 0
    while shard_tiles(number).start * TILE < job.config.runs:
        number += 1
    return number


def description(job: Job) -> Mapping[str, str]:
    """All that the numbers of a job depend on, the number of its runs apart, by its name."""
    config = job.config
    return {
        "--scenario": config.scenario,
        **{f"--{name.replace('_', '-')}": str(value) for name, value in config.options.items()},
        "--seed": str(config.seed),
        "--identifiers": ",".join(job.names),
        "--keep": "all" if job.every_block else "checkpoints",
        **{f"settings of {name}": _settings(method) for name, method in job.methods.items()},
        "source of adhesion-jax": keeping.of_package(),
        "source of your own files": keeping.of_outside(),
        **{f"version of {name}": version(name) for name in runtime.PACKAGES},
        "kind of processor or settings of jax": programs.digest(),
    }


def _settings(method: Identifier) -> str:
    leaves, form = jax.tree.flatten(method)
    content = sha256(programs.told(form) or type(method).__qualname__.encode())
    for leaf in map(np.asarray, leaves):
        content.update(f"{leaf.dtype} {leaf.shape}".encode() + leaf.tobytes())
    return content.hexdigest()
