"""How accurate every identifier is, each on a scenario of its own; on streams on three more."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import pandas as pd

from adhesion_jax.campaign.job import Config, build_scenario
from adhesion_jax.campaign.monte_carlo import run_campaign
from adhesion_jax.campaign.tiles import TILE
from adhesion_jax.errors import InputError
from adhesion_jax.identifiers import Identifier
from adhesion_jax.scenarios import SCENARIOS, Options, needs_options
from experiments.regression.table import ACCURACY, KEYS

#: Preferred scenarios. An identifier is measured on the first of these that it accepts, so that it
#: compiles once; if it accepts none of them, on the first of all scenarios that it accepts.
_STREAM = Config("qian2024-switch")
HOMES = (Config("he2018-blocks", options=Options(blocks=6)), _STREAM, Config("qian2024"))

#: Where those that live on the stream are measured, too: off the textbook.
AWAY = (Config("stream-coloured"), Config("stream-burckhardt"), Config("switch-drift"))


def homes(identifiers: Mapping[str, Identifier]) -> Mapping[str, Config]:
    """The scenario of each identifier; InputError if one accepts no scenario at all."""
    places = (*HOMES, *(Config(name) for name in SCENARIOS if not needs_options(name)))
    built = [(place, build_scenario(place)) for place in places]
    found = {}
    for name, identifier in identifiers.items():
        accepted = [
            place for place, scenario in built if identifier.accepts(scenario.known) is None
        ]
        if not accepted:
            raise InputError(f"identifier {name} accepts none of the scenarios.")
        found[name] = accepted[0]
    return found


def accuracy_steps(identifiers: Mapping[str, Identifier], runs: int) -> int:
    """The number of times that `measure_accuracy` reports progress."""
    return sum(-(-config.runs // TILE) for config in _campaigns(identifiers, runs, 0))


def measure_accuracy(
    identifiers: Mapping[str, Identifier],
    runs: int,
    seed: int,
    progress: Callable[[str], None],
) -> pd.DataFrame:
    """The accuracy rows of the table, one per identifier, rail and quantity."""
    tables = [
        run_campaign(config, lambda _: None, progress, 1, identifiers).tables["summary"]
        for config in _campaigns(identifiers, runs, seed)
    ]
    table = pd.concat(tables, ignore_index=True)
    again = table.groupby(list(KEYS), sort=False).cumcount()  # a rail that a run comes back to
    table["rail"] = table["rail"].where(again == 0, table["rail"] + " " + (again + 1).astype(str))
    return table[[*KEYS, *ACCURACY]]


def _campaigns(identifiers: Mapping[str, Identifier], runs: int, seed: int) -> tuple[Config, ...]:
    """One campaign for each scenario, of all identifiers that are measured on it."""
    residents: dict[Config, list[str]] = {}
    for name, home in homes(identifiers).items():
        for place in (home, *(AWAY if home == _STREAM else ())):
            residents.setdefault(place, []).append(name)
    return tuple(
        replace(home, identifiers=tuple(names), runs=runs, seed=seed)
        for home, names in residents.items()
    )
