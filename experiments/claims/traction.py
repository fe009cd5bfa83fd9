"""The runs without noise of a traction system, for its claims."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import pandas as pd

from adhesion_jax.campaign.traction import WHOLE, job_of, judge
from adhesion_jax.traction.loop import Trace
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.plants.reading import read_plant, shipped
from adhesion_jax.traction.systems.base import Case, System


class Quiet(NamedTuple):
    """The cases of a system on its plant, without noise."""

    cases: Sequence[Case]
    plant: Plant
    metrics: pd.DataFrame
    traces: Sequence[Trace]

    def figure(
        self, method: str, name: str, segment: str = WHOLE, scenario: str | None = None
    ) -> float:
        """One figure of one method, of the first scenario unless one is named."""
        rows = self.metrics[
            (self.metrics["method"] == method) & (self.metrics["segment"] == segment)
        ]
        if scenario is not None:
            rows = rows[rows["scenario"] == scenario]
        return float(rows[name].iloc[0])

    def trace(self, method: str, scenario: str | None = None) -> Trace:
        found = next(
            trace
            for case, trace in zip(self.cases, self.traces, strict=True)
            if case.method == method and scenario in (None, case.scenario)
        )
        return jax.tree.map(jnp.asarray, found)


def plant_of(system: System) -> Plant:
    return read_plant(shipped()[system.plant]).plant


def quiet_runs(
    system: System, cases: Sequence[Case], plant: Plant, progress: Callable[[str], None]
) -> Quiet:
    """Each case once, on a plant that control knows exactly."""
    judged = judge(job_of("claims", system, cases, plant), progress)
    return Quiet(cases, plant, judged.metrics, judged.traces)
