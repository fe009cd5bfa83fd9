"""How near the methods come to what the processor can do, as measured beside them."""

import ctypes
from collections.abc import Mapping

import jax
import jax.numpy as jnp
import numpy as np

from adhesion_jax.campaign.config import Config, build_scenario
from adhesion_jax.campaign.tiles import TILE, tiles_of
from adhesion_jax.identifiers import IDENTIFIERS
from adhesion_jax.optim.variable_projection import DEGREE
from adhesion_jax.scenarios.rails import RAILS
from experiments.speed.c_code import call
from experiments.speed.turns import Timed, Work, timed

RESIDUAL_PEER, PRODUCT_PEER, EXPONENTIAL_PEER = "residual loop in C", "matrix product", "exp in C"

#: Number of times that a piece of work is done in a turn: one takes less than a tick of the clock.
_TIMES = 200

_SIZE = 512


def entries(library: ctypes.CDLL | str) -> Mapping[tuple[str, str], Mapping[str, Timed]]:
    """By unit and peer, what is timed: sums of squares, matrix products and exponentials."""
    config = Config()
    records = tiles_of(config.scenario, build_scenario(config)).draw(config.seed, 0)
    slip = np.ascontiguousarray(records.slip[0])
    adhesion = np.ascontiguousarray(records.adhesion[:, 0])
    runs, points = adhesion.shape
    rail = RAILS["dry"]
    x = np.ascontiguousarray(np.tile([[rail.c1], [rail.c2], [rail.c3]], runs), dtype=float)
    sums = np.zeros(runs)
    curve = jax.jit(
        lambda x, slip, adhesion: jnp.sum(
            (x[0][:, None] * (1 - jnp.exp(-x[1][:, None] * slip)) - x[2][:, None] * slip - adhesion)
            ** 2,
            axis=1,
        )
    )
    exponents = np.linspace(-9.0, 0.0, adhesion.size)
    values = np.zeros_like(exponents)
    in_jax = jax.jit(jnp.exp)
    inputs = [jnp.asarray(one) for one in (x, slip, adhesion)]
    many = jnp.asarray(exponents)
    # That of jax: the one of NumPy starts threads, which take time from whatever follows.
    matrix = jnp.asarray(np.random.default_rng(0).normal(size=(_SIZE, _SIZE)))
    product = jax.jit(jnp.matmul)

    def in_c(name: str, amount: int, *arguments: int | float | np.ndarray) -> Timed:
        if isinstance(library, str):
            return Timed(None, library)
        return _often(lambda: call(library, name, arguments), amount)

    return {
        ("points", RESIDUAL_PEER): {
            RESIDUAL_PEER: in_c("squares", adhesion.size, runs, points, slip, adhesion, *x, sums),
            "the same in jax": _often(lambda: jax.block_until_ready(curve(*inputs)), adhesion.size),
            "lm": Timed(_points_of_lm(config), "points of the curve and its derivatives"),
        },
        ("operations", PRODUCT_PEER): {
            PRODUCT_PEER: _often(
                lambda: jax.block_until_ready(product(matrix, matrix)), 2 * _SIZE**3
            ),
            "ml-exact": Timed(_products(config), "of the product of its data with the shared grid"),
        },
        ("exponentials", EXPONENTIAL_PEER): {
            EXPONENTIAL_PEER: in_c("exponentials", many.size, many.size, exponents, values),
            "exp in NumPy": _often(lambda: np.exp(exponents), many.size),
            "exp in jax": _often(lambda: jax.block_until_ready(in_jax(many)), many.size),
        },
    }


def _often(function: object, amount: int) -> Timed:
    def again() -> None:
        for _ in range(_TIMES):
            function()  # type: ignore[operator]

    return Timed(timed(again, _TIMES * amount))


def _points_of_lm(config: Config) -> Work:
    """Points at which the curve was evaluated, in all steps of all runs."""
    tiles = tiles_of(config.scenario, build_scenario(config))

    def work(turn: int) -> tuple[float, float]:
        records = tiles.draw(config.seed, turn)
        result = tiles.identify(config.seed, turn, "lm", IDENTIFIERS["lm"], records)
        points = records.slip.shape[-1]
        each = 1 + len(RAILS["dry"].free)  # evaluations that a step counts for
        steps = float(np.sum(np.asarray(result.estimate.evaluations))) / each
        return steps * points, result.seconds

    return work


def _products(config: Config) -> Work:
    """Operations of the matrix of all nodes times the data of all runs and blocks."""
    tiles = tiles_of(config.scenario, build_scenario(config))

    def work(turn: int) -> tuple[float, float]:
        records = tiles.draw(config.seed, turn)
        result = tiles.identify(config.seed, turn, "ml-exact", IDENTIFIERS["ml-exact"], records)
        blocks, points = records.slip.shape
        return 2.0 * DEGREE * TILE * blocks * points, result.seconds

    return work
