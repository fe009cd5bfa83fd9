"""Recursions over streams of samples: the identifiers, and the same in NumPy."""

import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from adhesion_jax.campaign.job import Config, build_scenario
from adhesion_jax.campaign.tiles import COMPILER
from adhesion_jax.identifiers import IDENTIFIERS, Identifier
from adhesion_jax.records import Known, Record, record_axes
from adhesion_jax.scenarios import Options
from adhesion_jax.scenarios.rails import KIENCKE_RAILS
from experiments.speed import numpy_forms
from experiments.speed.turns import Timed, timed

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
