"""Recursions over streams of samples: the identifiers, and the same in NumPy and in numba."""

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from adhesion_jax.campaign.config import Config, build_scenario
from adhesion_jax.identifiers import IDENTIFIERS, Identifier
from adhesion_jax.records import Record, record_axes
from adhesion_jax.scenarios import Options
from adhesion_jax.scenarios.rails import KIENCKE_RAILS
from adhesion_jax.studies.speed.turns import Timed, absent, timed

UNIT = "samples"

#: The peers: NumPy over all the runs at once.
RECURSION_PEER, PROGRAM_PEER = "numpy-rls", "numpy-qp"
RECURSIONS = ("rls-kiencke", "rls-kiencke-variable")
PROGRAMS = ("qp-qian2024-1", "qp-qian2024-2")
RUNS, SAMPLES = 10_000, 500

#: Where the recursions start, and the weight of that start in the quadratic programs.
_START, _RIDGE = (100.0, 50.0), 1e-10

#: Number of groups that the runs are divided into, so that the states of a group fit into the
#: cache; NumPy, whose calls are slow, is fastest with all runs at once.
_GROUPS = 5

#: Timed programs are compiled with full optimisation, whatever the flags of the environment.
_OPTIMISED: dict[str, str | bool] = {"xla_backend_optimization_level": "3"}


def entries(seed: int) -> tuple[Mapping[str, Timed], Mapping[str, Timed]]:
    """What is timed of recursive least squares, and of the quadratic programs."""
    known = build_scenario(Config("qian2024", options=Options(points=SAMPLES))).known
    random = np.random.default_rng(seed)
    slip = random.uniform(0.0, 0.2, (SAMPLES, RUNS))
    clean = np.asarray(KIENCKE_RAILS["dry"](jnp.asarray(slip), {}))
    adhesion = clean + random.normal(0.0, 0.01, slip.shape)
    every = jnp.ones(SAMPLES, dtype=bool)
    groups = [
        Record(jnp.asarray(slip[:, runs]), jnp.asarray(adhesion[:, runs]), every, every, {})
        for runs in np.split(np.arange(RUNS), _GROUPS)
    ]
    axes = record_axes(1, 1, {})

    def over_runs(method: Identifier) -> Callable[[], object]:
        state = method.init(known, jax.random.key(0))
        update = jax.jit(jax.vmap(method.update, in_axes=(None, axes)), compiler_options=_OPTIMISED)
        return lambda: [jax.block_until_ready(update(state, group)) for group in groups]

    def entry(function: Callable[[], object], remark: str = "") -> Timed:
        return Timed(timed(function, slip.size), remark)

    missing = absent("numba")
    recursions = {
        RECURSION_PEER: entry(lambda: numpy_recursion(slip, adhesion)),
        "numba-rls": Timed(None, missing) if missing else entry(_numba_recursion(slip, adhesion)),
        **{name: entry(over_runs(IDENTIFIERS[name])) for name in RECURSIONS},
    }
    box = np.asarray(known.lower), np.asarray(known.upper)
    programs = {
        PROGRAM_PEER: entry(lambda: numpy_program(slip, adhesion, box)),
        **{name: entry(over_runs(IDENTIFIERS[name])) for name in PROGRAMS},
    }
    return recursions, programs


def _numba_recursion(slip: np.ndarray, adhesion: np.ndarray) -> Callable[[], object]:
    """One run after the other, each with its samples in a row."""

    @import_module("numba").njit(fastmath=True)
    def all_runs(slip: Any, adhesion: Any) -> Any:
        found = np.empty((slip.shape[0], 8))
        for run in range(slip.shape[0]):
            x1, x2, p11, p12, p22 = 100.0, 50.0, 1e10, 0.0, 1e10
            g11, g12, g22 = 0.0, 0.0, 0.0
            for k in range(slip.shape[1]):
                size, measured = slip[run, k], adhesion[run, k]
                u1 = size * measured
                u2 = size * u1
                eta = 0.99
                pu1, pu2 = p11 * u1 + p12 * u2, p12 * u1 + p22 * u2
                scale = eta + u1 * pu1 + u2 * pu2
                innovation = 40.0 * size - measured - x1 * u1 - x2 * u2
                squared = (innovation * eta / scale) ** 2
                step = innovation / scale
                x1, x2 = x1 + pu1 * step, x2 + pu2 * step
                p11 = (p11 - pu1 * pu1 / scale) / eta
                p12 = (p12 - pu1 * pu2 / scale) / eta
                p22 = (p22 - pu2 * pu2 / scale) / eta
                g11 = eta**2 * g11 + squared * u1 * u1
                g12 = eta**2 * g12 + squared * u1 * u2
                g22 = eta**2 * g22 + squared * u2 * u2
            found[run] = x1, x2, p11, p12, p22, g11, g12, g22
        return found

    rows = np.ascontiguousarray(slip.T), np.ascontiguousarray(adhesion.T)
    return lambda: all_runs(*rows)


def numpy_recursion(slip: np.ndarray, adhesion: np.ndarray) -> tuple[np.ndarray, ...]:
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


def numpy_program(
    slip: np.ndarray, adhesion: np.ndarray, box: tuple[np.ndarray, np.ndarray]
) -> tuple[np.ndarray, ...]:
    """What `qp-qian2024-2` does, with arrays [samples, runs], one step for all the runs."""
    runs, (lower, upper) = slip.shape[1], box
    x1, x2 = np.full(runs, _START[0]), np.full(runs, _START[1])
    h11, h12, h22, f1, f2, g11, g12, g22 = np.zeros((8, runs))
    for size, measured in zip(slip, adhesion, strict=True):
        u1 = size * measured
        u2 = size * u1
        z = 40.0 * size - measured
        predicted = 40.0 * size / (1 + x1 * size + x2 * size**2)
        eta = np.maximum(0.971, 1.0 - 2.0 * np.abs(measured - predicted))
        h11, h12, h22 = eta * h11 + u1 * u1, eta * h12 + u1 * u2, eta * h22 + u2 * u2
        f1, f2 = eta * f1 + u1 * z, eta * f2 + u2 * z
        pull = _RIDGE * (h11 + h22)
        y1, y2, a11, a22 = f1 + pull * _START[0], f2 + pull * _START[1], h11 + pull, h22 + pull
        determinant = a11 * a22 - h12**2
        safe = np.where(determinant > 0, determinant, 1.0)
        a, b = (y1 * a22 - y2 * h12) / safe, (y2 * a11 - y1 * h12) / safe
        inside = (determinant > 0) & (a >= lower[0]) & (a <= upper[0])
        inside &= (b >= lower[1]) & (b <= upper[1])
        edges = [(np.clip((y1 - e * h12) / a11, lower[0], upper[0]), e) for e in _ends(1, box)]
        edges += [(e, np.clip((y2 - e * h12) / a22, lower[1], upper[1])) for e in _ends(0, box)]
        best, x1, x2 = np.full(runs, np.inf), a, b
        for one, two in edges:
            value = one * (one * a11 + 2 * two * h12 - 2 * y1) + two * (two * a22 - 2 * y2)
            better = ~inside & (value < best)
            best = np.where(better, value, best)
            x1, x2 = np.where(better, one, x1), np.where(better, two, x2)
        squared = (z - x1 * u1 - x2 * u2) ** 2
        g11 = eta**2 * g11 + squared * u1 * u1
        g12 = eta**2 * g12 + squared * u1 * u2
        g22 = eta**2 * g22 + squared * u2 * u2
    return x1, x2, h11, h12, h22, g11, g12, g22


def _ends(place: int, box: tuple[np.ndarray, np.ndarray]) -> tuple[float, float]:
    return float(box[0][place]), float(box[1][place])
