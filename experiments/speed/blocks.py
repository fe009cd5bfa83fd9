"""Identifications of blocks: the identifiers, and other libraries on the same blocks."""

import time
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.optimize
from jaxtyping import Array, ArrayLike, Float, Key

from adhesion_jax.campaign.job import Config, build_scenario
from adhesion_jax.campaign.tiles import COMPILER, TILE, Tiles, tiles_of
from adhesion_jax.identifiers import IDENTIFIERS
from adhesion_jax.identifiers.ml_de import CROSSOVER, GENERATIONS, POPULATION
from adhesion_jax.optim import differential_evolution as de
from experiments.speed.turns import Timed, Work

#: The peer: scipy's differential evolution, the population in one call, at the settings of `ml-de`
#: but with all its generations.
PEER = "scipy-de"


class _Block(NamedTuple):
    """What another library is given."""

    slip: np.ndarray
    adhesion: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    random: np.random.Generator


_Solve = Callable[[_Block], object]

UNIT = "identifications"


def entries(seed: int) -> Mapping[str, Timed]:
    """What is timed on he2018-blocks; noise and compilation are not part of the time."""
    config = Config(seed=seed)
    scenario = build_scenario(config)
    others: Mapping[str, tuple[_Solve, str]] = {
        PEER: (_scipy_de, "population in one call of NumPy, all 300 generations"),
        "scipy-de-default": (_scipy_de_default, "as scipy is when nothing is set"),
        "minpack-lm": (_minpack, "Jacobian given; without a box"),
        "scipy-trf": (_trust_region, "Jacobian given; in the box"),
    }
    found = {
        name: Timed(_on_blocks(config, solve), remark) for name, (solve, remark) in others.items()
    }
    began = time.process_time()
    search = _all_points(config)
    remark = "as scipy-de: all 300 generations, on the sum of squares over all points"
    found["de-all-points"] = Timed(search, remark, time.process_time() - began)
    for name, method in IDENTIFIERS.items():
        if method.accepts(scenario.known) is None:
            began = time.process_time()
            _tiles(config).make_ready([method])
            seconds = time.process_time() - began
            found[name] = Timed(_identifier(config, name), "", seconds)
    return found


def _tiles(config: Config) -> Tiles:
    return tiles_of(config.scenario, build_scenario(config))


def _identifier(config: Config, name: str) -> Work:
    tiles = _tiles(config)

    def work(turn: int) -> tuple[float, float]:
        records = tiles.draw(config.seed, turn)
        result = tiles.identify(config.seed, turn, name, IDENTIFIERS[name], records)
        return float(np.size(result.estimate.status)), result.seconds

    return work


def _all_points(config: Config) -> Work:
    """All the first blocks of a tile side by side."""
    known = build_scenario(config).known
    slip = _tiles(config).draw(config.seed, 0).slip[0]
    search = search_of_all_points(slip, (known.lower, known.upper), TILE, POPULATION, GENERATIONS)

    def work(turn: int) -> tuple[float, float]:
        blocks = _tiles(config).draw(config.seed, turn).adhesion[:, 0]
        keys = jax.block_until_ready(jax.random.split(jax.random.key(turn), TILE))
        began = time.process_time()
        jax.block_until_ready(search(keys, blocks))
        return float(TILE), time.process_time() - began

    return work


def _on_blocks(config: Config, solve: _Solve) -> Work:
    """The first block of every rail of the first run of a tile."""
    known = build_scenario(config).known
    lower, upper = np.asarray(known.lower), np.asarray(known.upper)

    def work(turn: int) -> tuple[float, float]:
        slip, blocks = _first_blocks(config, turn)
        random = np.random.default_rng(turn)
        began = time.process_time()
        for adhesion in blocks:
            solve(_Block(slip, adhesion, lower, upper, random))
        return float(len(blocks)), time.process_time() - began

    return work


def _first_blocks(config: Config, tile: int) -> tuple[np.ndarray, np.ndarray]:
    records = _tiles(config).draw(config.seed, tile)
    groups = build_scenario(config).tables()["summary"]
    return np.asarray(records.slip[0]), np.asarray(records.adhesion)[
        0, [group.blocks[0] for group in groups]
    ]


def _model(x: Any, slip: Any) -> Any:
    return x[0] * (1 - np.exp(-x[1] * slip)) - x[2] * slip


def _jacobian(x: np.ndarray, slip: np.ndarray) -> np.ndarray:
    decay = np.exp(-x[1] * slip)
    return np.stack([1 - decay, x[0] * slip * decay, -slip], axis=1)


def _scipy_de(block: _Block) -> object:
    return scipy.optimize.differential_evolution(
        lambda x: np.sum((_model(x, block.slip[:, None]) - block.adhesion[:, None]) ** 2, axis=0),
        list(zip(block.lower, block.upper, strict=True)),
        strategy="rand1bin",
        init=block.random.uniform(block.lower, block.upper, (POPULATION, block.lower.size)),
        mutation=SCALE,
        recombination=CROSSOVER,
        maxiter=GENERATIONS,
        tol=0,
        polish=False,
        updating="deferred",
        vectorized=True,
        rng=block.random,
    )


def _scipy_de_default(block: _Block) -> object:
    return scipy.optimize.differential_evolution(
        lambda x: np.sum((_model(x, block.slip) - block.adhesion) ** 2),
        list(zip(block.lower, block.upper, strict=True)),
        rng=block.random,
    )


def _minpack(block: _Block) -> object:
    return scipy.optimize.leastsq(
        lambda x: _model(x, block.slip) - block.adhesion,
        0.5 * (block.lower + block.upper),
        Dfun=lambda x: _jacobian(x, block.slip),
    )


def _trust_region(block: _Block) -> object:
    return scipy.optimize.least_squares(
        lambda x: _model(x, block.slip) - block.adhesion,
        0.5 * (block.lower + block.upper),
        jac=lambda x: _jacobian(x, block.slip),
        bounds=(block.lower, block.upper),
        x_scale=block.upper - block.lower,
    )


# ----------------------------------------------- differential evolution over all points of a record

#: Its scale factor, that of `ml-de`.
SCALE = 0.5

#: Points whose squares are summed in one loop over members and runs: 5 and 25 are not faster.
_TOGETHER = 10

#: Whatever the flags of the environment.
_COMPILER = {**COMPILER, "xla_cpu_use_fusion_emitters": True}

Search = Callable[[Key[Array, " runs"], Float[Array, "runs points"]], Float[Array, "runs 3"]]


def search_of_all_points(
    slip: Float[Array, " points"],
    box: tuple[Float[ArrayLike, "3"], Float[ArrayLike, "3"]],
    runs: int,
    members: int,
    generations: int,
) -> Search:
    """The search of many runs on common slips, with all its generations, compiled.

    It is on the sum of squares over all points, which the identifiers reduce to a few sums first:
    nearly all of its time goes into exponentials.
    """
    lower, upper = map(jnp.asarray, box)
    settings = de.Settings(SCALE, CROSSOVER, reflect=False, tolerance=-1.0)

    def one(key: Key[Array, ""], adhesion: Float[Array, " points"]) -> Float[Array, "3"]:
        def sum_of_squares(x: Float[Array, "3"]) -> Float[Array, ""]:
            c1, c2, c3 = x

            def add(total: Array, point: tuple[Array, Array]) -> tuple[Array, None]:
                slip, adhesion = point
                left = c1 * (1 - jnp.exp(-c2 * slip)) - c3 * slip - adhesion
                return total + left**2, None

            # One point after the other, for members and runs side by side: a sum over points for
            # each of them takes three times as long.
            points = slip, adhesion
            return jax.lax.scan(add, jnp.zeros(()), points, unroll=_TOGETHER)[0]

        first, rest = jax.random.split(key)
        share = jax.random.uniform(first, (lower.size, members))
        population = lower[:, None] + (upper - lower)[:, None] * share
        found = de.minimise(sum_of_squares, population, lower, upper, rest, settings, generations)
        return found.x

    keys = jax.random.split(jax.random.key(0), runs)
    blocks = jax.ShapeDtypeStruct((runs, slip.size), slip.dtype)
    found: Search = jax.jit(jax.vmap(one)).lower(keys, blocks).compile(_COMPILER)
    return found
