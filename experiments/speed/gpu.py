"""Identifications on a GPU, where there is one, beside one core of the CPU."""

import os
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import NamedTuple

import jax
import numpy as np
import pandas as pd

from adhesion_jax import runtime
from adhesion_jax.campaign.job import Config
from adhesion_jax.campaign.tiles import TILE
from adhesion_jax.identifiers import Estimate
from adhesion_jax.runtime import silent
from adhesion_jax.scenarios import Options
from experiments.speed.scaling import Batch, batch_on
from experiments.speed.turns import Timed, rates, timed

PART = "GPU"

#: A core computes the runs of one tile at a time, as in a campaign.
PEER = f"one core, {TILE} runs"

#: A GPU needs many runs at once before its processors are in use.
RUN_COUNTS: Sequence[int] = (TILE, 2048, 32_768)


class Case(NamedTuple):
    """A method, the scenario of its runs, and what is counted of them."""

    method: str
    scenario: str
    unit: str


CASES = (
    Case("ml-exact", "single", "identifications"),
    Case("lm", "single", "identifications"),
    Case("ml-de-he2018", "single", "identifications"),
    Case("rls-kiencke", "qian2024-switch", "samples"),
    Case("qp-qian2024-1", "qian2024-switch", "samples"),
)

#: Of a block, and of a stream.
POINTS = 500


def table(turns: int, seed: int) -> pd.DataFrame:
    """The rates on the first GPU, or one row that says why there are none.

    They are measured in a process of its own, for commands leave a GPU alone.
    """
    try:
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as process:
            return process.submit(_measured, turns, seed).result()
    except (RuntimeError, AssertionError) as error:  # of jax, or because that process ended
        return rates(PART, "identifications", "", {PART: _failed(error)}, 0, silent)


def _failed(error: Exception) -> Timed:
    first, *_ = f"{error}".splitlines() or [type(error).__name__]
    return Timed(None, f"Not timed: the GPU cannot be used ({first}).")


def _measured(turns: int, seed: int) -> pd.DataFrame:
    jax.config.update("jax_enable_x64", True)
    chosen = os.environ.get("JAX_PLATFORMS", "")
    if chosen and "cpu" not in chosen.split(","):
        jax.config.update("jax_platforms", f"{chosen},cpu")  # beside which the GPU is measured
    first = jax.local_devices()[0]
    if first.platform != "gpu":
        none = Timed(None, "Not timed: jax finds no GPU.")
        return rates(PART, "identifications", "", {PART: none}, 0, silent)
    # What is not put on the GPU is computed elsewhere.
    jax.config.update("jax_default_device", "cpu")
    return measured_on(first, turns, seed)


def measured_on(device: jax.Device, turns: int, seed: int) -> pd.DataFrame:
    """The rates on this device beside those on the CPU, by the clock; noise is drawn before."""
    found = [
        rates(
            f"{PART}: {case.method}", case.unit, PEER, _entries(case, device, seed), turns, silent
        )
        for case in CASES
    ]
    return pd.concat(found, ignore_index=True)


def _entries(case: Case, device: jax.Device, seed: int) -> Mapping[str, Timed]:
    def batch(runs: int, where: jax.Device) -> Batch:
        config = Config(case.scenario, options=Options(points=POINTS), runs=runs, seed=seed)
        return batch_on(where, config, case.method)

    def entry(batch: Batch, runs: int, remark: str) -> Timed:
        amount = runs * POINTS if case.unit == "samples" else runs
        work = timed(batch.run, amount, time.perf_counter)
        return Timed(work, remark, batch.compile_seconds)

    core = batch(TILE, runtime.device())
    expected = core.run()
    found = {PEER: entry(core, TILE, "")}
    for runs in RUN_COUNTS:
        name = f"{device.device_kind}, {runs:,} runs"
        try:
            many = batch(runs, device)
            found[name] = entry(many, runs, _difference(many.run(), expected))
        except jax.errors.JaxRuntimeError as error:  # too little memory, say
            found[name] = _failed(error)
    return found


def _difference(found: Estimate, expected: Estimate) -> str:
    """How far the adhesion maxima differ in the runs of the first tile."""
    first = np.asarray(found.values["mu_max"])[:TILE]
    other = np.asarray(expected.values["mu_max"])
    differ = np.isnan(first) != np.isnan(other)
    if differ.any():
        runs = np.sum(differ.reshape(TILE, -1).any(axis=1))
        return f"{runs} of {TILE} runs lack an adhesion maximum on one of the two alone"
    most = np.nanmax(np.abs(first - other), initial=0.0)
    return f"mu_max of {TILE} runs differs from that of the core by {most:.1g} at most"
