"""Recursions over streams of samples: the identifiers, and the same in NumPy and in numba."""

import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from importlib import import_module
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from adhesion_jax.campaign.config import Config, build_scenario
from adhesion_jax.campaign.tiles import COMPILER
from adhesion_jax.identifiers import IDENTIFIERS, Identifier
from adhesion_jax.records import Known, Record, record_axes
from adhesion_jax.scenarios import Options
from adhesion_jax.scenarios.rails import KIENCKE_RAILS
from experiments.speed import numpy_forms
from experiments.speed.turns import Timed, absent, timed

UNIT = "samples"

#: Each is a part of its own, and its peer is the same method in NumPy over all the runs at once.
RECURSIONS = {
    "rls-kiencke": numpy_forms.rls_kiencke,
    "rls-kiencke-variable": numpy_forms.rls_kiencke_variable,
}
PROGRAMS = {
    "qp-qian2024-1": numpy_forms.qp_qian2024_1,
    "qp-qian2024-2": numpy_forms.qp_qian2024_2,
    "qp-bias-compensated": numpy_forms.qp_bias_compensated,
}
RUNS, SAMPLES = 10_000, 500

#: Number of runs of a group, whose states fit into the cache; NumPy, whose calls are slow, is
#: fastest with all runs at once.
_GROUP = 500


def entries(seed: int) -> Mapping[tuple[str, str], Mapping[str, Timed]]:
    """What is timed of recursions and of quadratic programs, by part and peer."""
    known = build_scenario(Config("qian2024", options=Options(points=SAMPLES))).known
    random = np.random.default_rng(seed)
    slip = random.uniform(0.0, 0.2, (SAMPLES, RUNS))
    clean = np.asarray(KIENCKE_RAILS["dry"](jnp.asarray(slip), {}))
    adhesion = clean + random.normal(0.0, 0.01, slip.shape)
    every = jnp.ones(SAMPLES, dtype=bool)
    groups = [
        Record(jnp.asarray(slip[:, runs]), jnp.asarray(adhesion[:, runs]), every, every, {})
        for runs in np.split(np.arange(RUNS), range(_GROUP, RUNS, _GROUP))
    ]
    box = np.asarray(known.lower), np.asarray(known.upper)
    forms: dict[tuple[str, str], Callable[[], object]] = {
        ("recursion", name): partial(form, slip, adhesion) for name, form in RECURSIONS.items()
    }
    for name, program in PROGRAMS.items():
        forms["quadratic program", name] = partial(program, slip, adhesion, box)
    found: dict[tuple[str, str], dict[str, Timed]] = {}
    for (kind, name), in_numpy in forms.items():
        function, seconds = _over_runs(IDENTIFIERS[name], known, groups)
        found[f"{kind}: {name}", f"numpy-{name}"] = {
            f"numpy-{name}": Timed(timed(in_numpy, slip.size)),
            name: Timed(timed(function, slip.size), "", seconds),
        }
    missing = absent("numba")
    found["recursion: rls-kiencke", "numpy-rls-kiencke"]["numba-rls-kiencke"] = (
        Timed(None, missing)
        if missing
        else Timed(timed(_numba_recursion(slip, adhesion), slip.size))
    )
    return found


def _over_runs(
    method: Identifier, known: Known, groups: Sequence[Record]
) -> tuple[Callable[[], object], float]:
    """The update of all the runs, group by group, and the CPU-seconds to compile it."""
    state = method.init(known, jax.random.key(0))
    batch = jax.jit(jax.vmap(method.update, in_axes=(None, record_axes(1, 1, {}))))
    began = time.process_time()
    update = batch.lower(state, groups[0]).compile(COMPILER)
    seconds = time.process_time() - began
    return lambda: [jax.block_until_ready(update(state, group)) for group in groups], seconds


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
