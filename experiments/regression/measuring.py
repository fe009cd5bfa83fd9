"""How accurate every identifier is, each on a scenario of its own; on streams on three more.

And how fast it is, as a ratio to a peer in NumPy that is timed in the same process.
"""

import time
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import pandas as pd

from adhesion_jax.campaign.job import Config, build_scenario
from adhesion_jax.campaign.monte_carlo import run_campaign
from adhesion_jax.campaign.tiles import TILE, tiles_of
from adhesion_jax.errors import InputError
from adhesion_jax.identifiers import Identifier
from adhesion_jax.scenarios import SCENARIOS, Options, needs_options
from adhesion_jax.scenarios.rails import RAILS
from experiments.regression.table import ACCURACY, KEYS, SPEED

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


# ------------------------------------------------------------------------------------------ speed

#: Fewest CPU seconds for which an identifier is timed in a turn.
_LEAST_SECONDS = 0.2

#: Number of pieces of the peer's work before, and again after, an identifier is timed.
_PEER_REPEATS = 3

_PEER_CURVES, _PEER_POINTS, _PEER_STEPS = 64, 500, 8


def peer_seconds() -> float:
    """CPU seconds of one piece of the peer's work, which is always the same.

    Gauss-Newton on Burckhardt's curve, many curves at a time: exponentials, residuals and normal
    equations over points, as in the identifiers, and in one thread.
    """
    rail = RAILS["dry"]
    truth = np.array([float(rail.c1), float(rail.c2), float(rail.c3)])
    slip = np.linspace(0, 0.2, _PEER_POINTS)
    noise = 0.01 * np.random.default_rng(0).normal(size=(_PEER_CURVES, _PEER_POINTS))
    adhesion = truth[0] * (1 - np.exp(-truth[1] * slip)) - truth[2] * slip + noise
    x = np.tile(0.9 * truth, (_PEER_CURVES, 1))
    began = time.process_time()
    for _ in range(_PEER_STEPS):
        decay = np.exp(-x[:, 1:2] * slip)
        residual = x[:, :1] * (1 - decay) - x[:, 2:] * slip - adhesion
        columns = (1 - decay, x[:, :1] * slip * decay, np.broadcast_to(-slip, decay.shape))
        normal = np.array([[np.sum(a * b, axis=1) for a in columns] for b in columns])
        right = np.array([np.sum(a * residual, axis=1) for a in columns])
        x = x - np.linalg.solve(np.moveaxis(normal, -1, 0), right.T[..., None])[..., 0]
    return time.process_time() - began


def measure_speed(
    identifiers: Mapping[str, Identifier], turns: int, progress: Callable[[str], None]
) -> pd.DataFrame:
    """The speed rows of the table: runs identified while the peer does one piece of work.

    The identifiers take turns, and the peer is timed before and after each, so that a machine
    whose speed drifts is fair to all. The same runs every time; noise and compilation are not
    timed. The median of the turns is reported, and half the distance between their quartiles.
    """
    places = homes(identifiers)
    ratios: dict[str, list[float]] = {name: [] for name in identifiers}
    for turn in range(turns + 1):
        for name, method in identifiers.items():
            ratio = _ratio(places[name], name, method)
            if turn > 0:  # the first turn compiles and warms up
                ratios[name].append(ratio)
            progress(name)
    rows = [
        {
            "scenario": places[name].scenario,
            "identifier": name,
            "rail": "",
            "quantity": SPEED,
            "speed": float(np.median(seen)),
            "speed_spread": float(np.subtract(*np.quantile(seen, [0.75, 0.25]))) / 2,
        }
        for name, seen in ratios.items()
    ]
    return pd.DataFrame(rows)


def _ratio(config: Config, name: str, method: Identifier) -> float:
    peer = [peer_seconds() for _ in range(_PEER_REPEATS)]
    tiles = tiles_of(config.scenario, build_scenario(config))
    spent: list[float] = []
    while sum(spent) < _LEAST_SECONDS:
        records = tiles.draw(config.seed, 0)
        spent.append(tiles.identify(config.seed, 0, name, method, records).seconds)
    peer += [peer_seconds() for _ in range(_PEER_REPEATS)]
    return TILE * float(np.mean(peer)) / float(np.mean(spent))
