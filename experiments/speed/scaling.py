"""How the rate changes with the number of runs, of points, of members and of cores."""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import jax
import pandas as pd

from adhesion_jax import runtime
from adhesion_jax.campaign.job import Config, build_scenario
from adhesion_jax.scenarios import Options
from experiments.speed import all_points
from experiments.speed.batches import batch_on, drawn
from experiments.speed.turns import Timed, rates, timed

#: The methods whose rates are followed.
METHODS = ("ml-exact", "lm")

RUN_COUNTS: Sequence[int] = (1, 16, 128, 512)
POINT_COUNTS: Sequence[int] = (125, 500, 2000)
MEMBER_COUNTS: Sequence[int] = (10, 20, 40, 80)

#: Generations of differential evolution, on the uncompressed sum of squares.
_GENERATIONS = 50

_RUNS, _POINTS = 128, 500


class Size(NamedTuple):
    """One quantity that is varied, and its value."""

    along: str
    value: int


def sizes() -> list[Size]:
    """All that is timed, in order."""
    return [
        *(Size("runs", runs) for runs in RUN_COUNTS),
        *(Size("points", points) for points in POINT_COUNTS),
        *(Size("members", members) for members in MEMBER_COUNTS),
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
    ready = all_points.search(records.slip[0], box, _RUNS, members, _GENERATIONS)
    keys, blocks = jax.random.split(jax.random.key(seed), _RUNS), records.adhesion[:, 0]
    return Timed(timed(lambda: jax.block_until_ready(ready(keys, blocks)), _RUNS))
