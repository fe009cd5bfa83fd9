"""What a campaign computes: a configuration, its methods, and how its runs are divided.

A shard is a number of runs of all methods, the unit that is computed by one process and that is
stored or not. The first shards are small, so that few runs are shared among processes, too; the
later ones are large, so that millions of runs need few of them. Which runs a shard has depends on
its number alone.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import jax
import numpy as np

from adhesion_jax.campaign.identity import settings_of
from adhesion_jax.campaign.tiles import TILE, Tiles, tiles_of
from adhesion_jax.errors import InputError
from adhesion_jax.identifiers import ABLATIONS, IDENTIFIERS, Identifier
from adhesion_jax.options import check_accepted
from adhesion_jax.scenarios import SCENARIOS, Group, Options, Scenario, build, needs_options
from adhesion_jax.scenarios.course import switches

#: What runs when no scenario is named: curves identified block by block, and a stream.
MAIN_JOB = ("he2018-blocks", "qian2024-switch")

#: What stands for all scenarios: those that need no option and ask for the peak. A sequence that
#: grows is left out, as it is a block of each of its lengths.
ALL = "all"
_NOT_IN_ALL = ("he2018-1", "qian2024", "fang2018-slope")

#: What runs for a name that is none of one scenario.
SEVERAL: Mapping[str | None, tuple[str, ...]] = {
    None: MAIN_JOB,
    ALL: tuple(n for n in SCENARIOS if n not in _NOT_IN_ALL and not needs_options(n)),
}


@dataclass(frozen=True)
class Config:
    """One campaign. Without identifiers: all that accept the scenario, ablations left out."""

    scenario: str = "he2018-blocks"
    identifiers: tuple[str, ...] = ()
    options: Options = field(default_factory=Options)
    runs: int = 1000
    seed: int = 0


def build_scenario(config: Config) -> Scenario:
    """The scenario with the user's options; an InputError where they do not fit it."""
    if config.scenario not in SCENARIOS:
        raise InputError(
            f"--scenario {config.scenario} is unknown; the scenarios are {', '.join(SCENARIOS)}."
        )
    return build(config.scenario, config.options)


def choose_identifiers(
    config: Config, scenario: Scenario, identifiers: Mapping[str, Identifier] = IDENTIFIERS
) -> tuple[str, ...]:
    """The names to run, in the order of the registry or of the command line."""
    if not config.identifiers:
        return tuple(
            name
            for name, identifier in identifiers.items()
            if name not in ABLATIONS and identifier.accepts(scenario.known) is None
        )
    _refuse_unknown(config, identifiers)
    for name in config.identifiers:
        check_accepted(name, config.scenario, identifiers[name].accepts(scenario.known))
    return tuple(dict.fromkeys(config.identifiers))


def parts_of(
    config: Config, scenarios: Sequence[str], identifiers: Mapping[str, Identifier] = IDENTIFIERS
) -> list[Config]:
    """The configurations of those scenarios that take the options and identifiers of `config`.

    Scenarios that do not support one of the options are skipped, and so are identifiers that a
    scenario rejects. InputError if nothing remains.
    """
    _refuse_unknown(config, identifiers)
    parts, refusals = [], []
    for scenario in scenarios:
        part = dataclasses.replace(config, scenario=scenario)
        try:
            built = build_scenario(part)
            suited = [n for n in config.identifiers if identifiers[n].accepts(built.known) is None]
            part = dataclasses.replace(part, identifiers=tuple(suited) or config.identifiers)
            choose_identifiers(part, built, identifiers)
        except InputError as refusal:
            refusals.append(refusal)
        else:
            parts.append(part)
    chosen = {name for part in parts for name in part.identifiers}
    left = [name for name in config.identifiers if name not in chosen]
    if not parts:
        raise refusals[0]
    if left:
        raise InputError(
            f"--identifiers {', '.join(left)} does not go with what is left of the scenarios "
            f"({' and '.join(part.scenario for part in parts)}); name a --scenario."
        )
    return parts


def _refuse_unknown(config: Config, identifiers: Mapping[str, Identifier]) -> None:
    for name in config.identifiers:
        if name not in identifiers:
            raise InputError(
                f"--identifiers {name} is unknown; the identifiers are {', '.join(identifiers)}."
            )


#: The method with whose objective every other is compared.
REFERENCE = "ml-exact"

#: The number of shards that have one tile, and of those that have two, four and so on; and the
#: number of tiles of the largest.
_ALIKE = 16
_LARGEST = 32

#: Tiles of a shard times blocks of a run are at most this, one tile apart.
_MOST_BLOCKS = 512

#: What the settings of a method are recorded under, before its name.
_SETTINGS = "settings of the method "

#: Blocks after a switch whose estimates are kept for every run.
_AFTER_SWITCH = 5


class Row(NamedTuple):
    """The table and the row to which some statistics belong."""

    table: str
    group: Group
    identifier: str


class Job(NamedTuple):
    """A configuration, its scenario, and its methods by name, of which `names` are reported."""

    config: Config
    scenario: Scenario
    methods: Mapping[str, Any]  # an `Identifier` each; None where shards are only read
    names: tuple[str, ...]
    every_block: bool  # whether the estimates of all blocks are kept, or of a few

    @staticmethod
    def of(
        config: Config,
        identifiers: Mapping[str, Identifier] = IDENTIFIERS,
        every_block: bool = True,
    ) -> "Job":
        """With the methods of these names; the reference is among them if it fits the scenario."""
        scenario = build_scenario(config)
        names = choose_identifiers(config, scenario, identifiers)
        reference = identifiers.get(REFERENCE)
        fits = reference is not None and reference.accepts(scenario.known) is None
        wanted = dict.fromkeys((*([REFERENCE] if fits else []), *names))
        methods = {name: identifiers[name] for name in wanted}
        return Job(config, scenario, methods, names, every_block)

    @property
    def tiles(self) -> Tiles:
        return tiles_of(self.name, self.scenario)

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
        return tuple(rails[b] for b in (0, *switches(rails)))

    @property
    def longest(self) -> int:
        """The number of steps of a method on the longest stretch."""
        scenario = self.scenario
        blocks = int(np.max(np.diff([0, *switches(scenario.rails), len(scenario.rails)])))
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
        near = {b + j for b in switches(rails) for j in range(-1, _AFTER_SWITCH)}
        return np.array(sorted(b for b in near | {len(rails) - 1} if b < len(rails)))

    @property
    def name(self) -> str:
        return self.config.scenario

    @property
    def runs(self) -> int:
        return self.config.runs

    @property
    def shards(self) -> int:
        """The number of shards that have all the runs."""
        number = 0
        while self.tiles_of(number).start * TILE < self.runs:
            number += 1
        return number

    def tiles_of(self, shard: int) -> range:
        """The tiles of the shard of this number."""
        size, first, most = 1, 0, self.most_tiles
        while size < most and shard >= _ALIKE:
            first, shard, size = first + _ALIKE * size, shard - _ALIKE, 2 * size
        return range(first + shard * size, first + (shard + 1) * size)

    def runs_of(self, shard: int) -> int:
        """The number of runs of a shard: the last one has what remains."""
        tiles = self.tiles_of(shard)
        return min(tiles.stop * TILE, self.runs) - tiles.start * TILE

    @property
    def most_tiles(self) -> int:
        """The number of tiles of the largest shards, a power of two.

        Runs of many blocks have fewer runs in a shard, so that it takes as much memory.
        """
        blocks = max(len(self.scenario.rails), 1)
        return 2 ** int(np.log2(max(min(_LARGEST, _MOST_BLOCKS // blocks), 1)))

    @property
    def record(self) -> Mapping[str, Any]:
        """What the job is, in the words of JSON, the number of its runs apart."""
        config = self.config
        depends = {
            "--scenario": config.scenario,
            **{f"--{name.replace('_', '-')}": str(value) for name, value in config.options.items()},
            "--seed": str(config.seed),
            "--identifiers": ",".join(self.names),
            "--keep": "all" if self.every_block else "checkpoints",
            "settings of the scenario": settings_of(self.scenario),
            **{f"{_SETTINGS}{name}": settings_of(one) for name, one in self.methods.items()},
        }
        return {"options": dict(config.options), "depends on": depends}

    @staticmethod
    def recorded(record: Mapping[str, Any]) -> "Job":
        """The job of a record, for reading its shards: it has the names of its methods alone."""
        told = record["depends on"]
        names = tuple(told["--identifiers"].split(","))
        config = Config(
            told["--scenario"],
            names,
            Options(**record["options"]),
            record["runs"],
            int(told["--seed"]),
        )
        methods = [key.removeprefix(_SETTINGS) for key in told if key.startswith(_SETTINGS)]
        return Job(
            config, build_scenario(config), dict.fromkeys(methods), names, told["--keep"] == "all"
        )
