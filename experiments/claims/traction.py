"""The runs of a traction system without noise, side by side, for its claims."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, TypeVar

import jax
import numpy as np

from adhesion_jax.campaign.loops import computed
from adhesion_jax.traction.loop import Loop, Timing, Trace, timing
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.plants.reading import read_plant, shipped
from adhesion_jax.traction.systems.base import System
from experiments.claims.settings import Numbers

Part = TypeVar("Part")


class Runs(NamedTuple):
    """Runs of loops of one form: their figures [runs, segments], and what is drawn of them."""

    segments: Sequence[str]  # their names; the last is the whole run
    figures: Mapping[str, Numbers]
    trace: Trace  # [runs, rows, ...]

    def figure(self, name: str, segment: str = "all") -> Numbers:
        return self.figures[name][:, list(self.segments).index(segment)]

    def axle(self, name: str) -> Numbers:
        """A signal of the first axle, [runs, rows]."""
        return np.asarray(getattr(self.trace.sample, name))[..., 0]

    @property
    def time(self) -> Numbers:
        return np.asarray(self.trace.time)[0]

    def part(self, first: int, last: int | None) -> "Runs":
        """Some of the runs."""
        figures = {name: values[first:last] for name, values in self.figures.items()}
        rows = jax.tree.map(lambda values: values[first:last], self.trace)
        return Runs(self.segments, figures, rows)


def plant_of(system: System) -> Plant:
    return read_plant(shipped()[system.plant]).plant


def changed(part: Part, **numbers: Any) -> Part:
    """A part of a loop with other numbers."""
    return dataclasses.replace(part, **numbers)  # type: ignore[type-var]


def grid_of(system: System, loop: Loop) -> Timing:
    return timing(loop, system.step, system.control_period or system.step, system.duration)


def runs_of(system: System, segments: Sequence[str], loops: Sequence[Loop]) -> Runs:
    """Loops of one form, each once without noise, computed by one program."""
    found = computed(loops, grid_of(system, loops[0]), 0, "", range(len(loops)), drawn=True)
    return Runs([*segments, "all"], found.figures, found.course)
