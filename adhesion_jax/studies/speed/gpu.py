"""Identifications on a GPU, where there is one, beside one core of the CPU."""

import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import NamedTuple

import jax
import numpy as np
import pandas as pd

from adhesion_jax import runtime
from adhesion_jax.campaign.config import Config
from adhesion_jax.campaign.tiles import TILE
from adhesion_jax.identifiers import Estimate
from adhesion_jax.runtime import silent
from adhesion_jax.scenarios import Options
from adhesion_jax.studies.speed.batches import Batch, batch_on
from adhesion_jax.studies.speed.turns import Timed, rates, timed

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
    Case("rls-kiencke", "qian2024", "samples"),
    Case("qp-qian2024-1", "qian2024", "samples"),
)

POINTS = 500


def table(turns: int, seed: int) -> pd.DataFrame:
    """The rates on the first GPU, or one row that says why there are none.

    They are measured in a process of its own, for commands leave a GPU alone.
    """
    try:
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as process:
            return process.submit(_measured, turns, seed).result()
    except RuntimeError as error:  # of jax, or because that process ended
        return _not_timed(f"the GPU cannot be used ({str(error).splitlines()[0]})")


def _measured(turns: int, seed: int) -> pd.DataFrame:
    jax.config.update("jax_enable_x64", True)
    jax.config.update("jax_platforms", None)  # whatever there is
    first = jax.local_devices()[0]
    if first.platform != "gpu":
        return _not_timed("jax finds no GPU")
    # What is not put on the GPU is computed elsewhere.
    jax.config.update("jax_default_device", jax.local_devices(backend="cpu")[0])
    return measured_on(first, turns, seed)


def _not_timed(why: str) -> pd.DataFrame:
    return rates(PART, "identifications", "", {PART: Timed(None, f"Not timed: {why}.")}, 0, silent)


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
        on_device = batch(runs, device)
        apart = _apart(on_device.run(), expected)
        remark = f"mu_max of {TILE} runs differs from that of the core by {apart:.1g} at most"
        found[f"{device.device_kind}, {runs:,} runs"] = entry(on_device, runs, remark)
    return found


def _apart(found: Estimate, expected: Estimate) -> float:
    """The largest difference of the adhesion maximum in the runs of the first tile.

    It is infinite where one has none and the other does.
    """
    first = np.asarray(found.values["mu_max"])[:TILE]
    other = np.asarray(expected.values["mu_max"])
    if np.any(np.isnan(first) != np.isnan(other)):
        return np.inf
    return float(np.nanmax(np.abs(first - other), initial=0.0))
