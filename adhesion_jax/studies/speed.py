"""Speed on one core beside a peer in the same run: blocks beside scipy, recursions beside NumPy."""

import time
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
from scipy.optimize import differential_evolution

from adhesion_jax.campaign.config import Config, build_scenario
from adhesion_jax.campaign.tiles import TILE, draw_tile, identify_tile
from adhesion_jax.identifiers import IDENTIFIERS, Identifier
from adhesion_jax.identifiers.ml_de import CROSSOVER, GENERATIONS, POPULATION
from adhesion_jax.records import Record, record_axes
from adhesion_jax.scenarios import Options
from adhesion_jax.scenarios.rails import KIENCKE_RAILS

#: The peer: scipy's vectorised differential evolution at the settings of `ml-de`, all generations.
PEER = "scipy-de"

#: The peer of the recursions: the same recursive least squares, NumPy over all the runs at once.
RECURSION_PEER = "numpy-rls"
RECURSIONS = ("rls-kiencke", "rls-kiencke-variable", "qp-qian2024-1", "qp-qian2024-2")
RECURSION_RUNS, RECURSION_SAMPLES = 10_000, 500

#: Number of groups that the runs are divided into, so that the states of a group fit into the
#: cache; NumPy, whose calls are slow, is fastest with all runs at once.
RECURSION_GROUPS = 5

#: Timed programs are compiled with full optimisation, whatever the flags of the environment.
_OPTIMISED: dict[str, str | bool] = {"xla_backend_optimization_level": "3"}


def timed(seed: int) -> tuple[str, ...]:
    """The methods of `block_table`: the peer, and every identifier that accepts the blocks."""
    scenario = build_scenario(Config(seed=seed))
    return (
        PEER,
        *(name for name, one in IDENTIFIERS.items() if one.accepts(scenario.known) is None),
    )


def block_table(repeats: int, seed: int, progress: Callable[[str], None]) -> pd.DataFrame:
    """Identifications per CPU-second on he2018-blocks, noise and compilation excluded.

    The methods take turns, so that a machine whose speed drifts is fair to all; the median is
    reported. `progress` is given the name of what was timed.
    """
    config = Config(seed=seed)
    rails = len(build_scenario(config).rails)
    rates: dict[str, list[float]] = {name: [] for name in timed(seed)}
    compile_seconds = dict.fromkeys(rates, 0.0)
    for turn in range(repeats + 1):
        for name in rates:
            if name == PEER:
                rate = _peer_rate(config, turn)
            else:
                result = identify_tile(config, turn, name, IDENTIFIERS[name])
                rate = TILE * rails / result.seconds
                compile_seconds[name] += result.compile_seconds
            if turn > 0:  # the first turn compiles and warms up
                rates[name].append(rate)
            progress(name)
    median = {name: float(np.median(values)) for name, values in rates.items()}
    return pd.DataFrame(
        {
            "identifier": list(rates),
            "identifications_per_cpu_second": list(median.values()),
            "lowest": [min(values) for values in rates.values()],
            "highest": [max(values) for values in rates.values()],
            "ratio_to_scipy_de": [value / median[PEER] for value in median.values()],
            "compile_seconds": list(compile_seconds.values()),
        }
    )


def recursion_table(repeats: int, seed: int) -> pd.DataFrame:
    """Samples per CPU-second of each recursion and of the peer, on the same records."""
    built = build_scenario(Config("qian2024", options=Options(points=RECURSION_SAMPLES)))
    known = built.known
    random = np.random.default_rng(seed)
    shape = (RECURSION_SAMPLES, RECURSION_RUNS)
    slip = random.uniform(0.0, 0.2, shape)
    clean = np.asarray(KIENCKE_RAILS["dry"](jnp.asarray(slip), {}))
    adhesion = clean + random.normal(0.0, 0.01, shape)
    every = jnp.ones(RECURSION_SAMPLES, dtype=bool)
    groups = [
        Record(jnp.asarray(slip[:, runs]), jnp.asarray(adhesion[:, runs]), every, every, {})
        for runs in np.split(np.arange(RECURSION_RUNS), RECURSION_GROUPS)
    ]
    axes = record_axes(1, 1, {})

    def over_runs(method: Identifier) -> Callable[[], object]:
        state = method.init(known, jax.random.key(0))
        update = jax.jit(jax.vmap(method.update, in_axes=(None, axes)), compiler_options=_OPTIMISED)
        return lambda: [jax.block_until_ready(update(state, group)) for group in groups]

    work: dict[str, Callable[[], object]] = {
        RECURSION_PEER: lambda: _numpy_recursion(slip, adhesion),
        **{name: over_runs(IDENTIFIERS[name]) for name in RECURSIONS},
    }
    rates: dict[str, list[float]] = {name: [] for name in work}
    for turn in range(repeats + 1):
        for name, run_once in work.items():
            began = time.process_time()
            run_once()
            if turn > 0:  # the first turn compiles and warms up
                rates[name].append(np.prod(shape) / (time.process_time() - began))
    median = {name: float(np.median(values)) for name, values in rates.items()}
    return pd.DataFrame(
        {
            "recursion": list(work),
            "samples_per_cpu_second": list(median.values()),
            "lowest": [min(values) for values in rates.values()],
            "highest": [max(values) for values in rates.values()],
            "ratio_to_numpy": [value / median[RECURSION_PEER] for value in median.values()],
        }
    )


def _numpy_recursion(slip: np.ndarray, adhesion: np.ndarray) -> tuple[np.ndarray, ...]:
    """What `rls-kiencke` does, with arrays [samples, runs], one step for all the runs."""
    runs = slip.shape[1]
    x1, x2 = np.full(runs, 100.0), np.full(runs, 50.0)
    p11, p12, p22 = np.full(runs, 1e10), np.zeros(runs), np.full(runs, 1e10)
    g11, g12, g22 = np.zeros(runs), np.zeros(runs), np.zeros(runs)
    for size, measured in zip(slip, adhesion, strict=True):
        u1 = size * measured
        u2 = size * u1
        z = 40.0 * size - measured
        predicted = 40.0 * size / (1 + x1 * size + x2 * size**2)
        eta = np.maximum(0.99, 0.99 - 0.0 * np.abs(measured - predicted))
        pu1, pu2 = p11 * u1 + p12 * u2, p12 * u1 + p22 * u2
        scale = eta + u1 * pu1 + u2 * pu2
        innovation = z - x1 * u1 - x2 * u2
        squared = (innovation * eta / scale) ** 2
        step = innovation / scale
        x1, x2 = x1 + pu1 * step, x2 + pu2 * step
        p11, p12, p22 = (
            (p11 - pu1 * pu1 / scale) / eta,
            (p12 - pu1 * pu2 / scale) / eta,
            (p22 - pu2 * pu2 / scale) / eta,
        )
        g11 = eta**2 * g11 + squared * u1 * u1
        g12 = eta**2 * g12 + squared * u1 * u2
        g22 = eta**2 * g22 + squared * u2 * u2
    return x1, x2, p11, p12, p22, g11, g12, g22


def _peer_rate(config: Config, turn: int) -> float:
    """Rate of scipy on the first block of every rail of one run of the tile."""
    scenario = build_scenario(config)
    records = draw_tile(config, turn)
    slip = np.asarray(records.slip[0])[:, None]
    lower, upper = np.asarray(scenario.known.lower), np.asarray(scenario.known.upper)
    first_blocks = [group.blocks[0] for group in scenario.tables()["summary"]]
    random = np.random.default_rng(turn)
    seconds = 0.0
    for block in first_blocks:
        adhesion = np.asarray(records.adhesion[0, block])[:, None]

        def objective(x: np.ndarray, adhesion: np.ndarray = adhesion) -> np.ndarray:
            model = x[0] * (1 - np.exp(-x[1] * slip)) - x[2] * slip
            return np.sum((model - adhesion) ** 2, axis=0)

        population = random.uniform(lower, upper, (POPULATION, lower.size))
        began = time.process_time()
        differential_evolution(
            objective,
            list(zip(lower, upper, strict=True)),
            strategy="rand1bin",
            init=population,
            mutation=0.5,
            recombination=CROSSOVER,
            maxiter=GENERATIONS,
            tol=0,
            polish=False,
            updating="deferred",
            vectorized=True,
            rng=random,
        )
        seconds += time.process_time() - began
    return len(first_blocks) / seconds
