"""The runs of a traction system without noise, side by side, for its claims."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from itertools import accumulate, pairwise
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from adhesion_jax.campaign.loops import computed
from adhesion_jax.report.traction.panels import Panel
from adhesion_jax.traction.loop import Loop, Timing, Trace, timing
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.plants.reading import read_plant, shipped
from adhesion_jax.traction.systems.base import System
from experiments.claims.claim import Claim, Flags, Numbers, Paper, Setting

Part = TypeVar("Part")


class Runs(NamedTuple):
    """Runs of loops of one form: their figures [runs, segments], and what is drawn of them."""

    segments: Sequence[str]  # their names; the last is the whole run
    figures: Mapping[str, Numbers]
    trace: Trace  # [runs, rows, ...]

    def figure(self, name: str, segment: str = "all") -> Numbers:
        return self.figures[name][:, list(self.segments).index(segment)]

    def each(self, name: str, segments: Sequence[str] = ()) -> Numbers:
        """On these segments, by default on all: [segments, runs]."""
        return np.array([self.figure(name, one) for one in segments or self.segments[:-1]])

    def axle(self, name: str) -> Numbers:
        """A signal of the first axle, [runs, rows]."""
        return np.asarray(getattr(self.trace.sample, name))[..., 0]

    @property
    def time(self) -> Numbers:
        return np.asarray(self.trace.time)[0]


class Found(NamedTuple):
    """The claims of a control system over settings, what is drawn over one of these, and more.

    The paper's `cloud` says what that is: a number of each setting, and whether its claim holds.
    """

    paper: Paper
    settings: Sequence[Setting]
    claims: Sequence[Claim]
    numbers: Numbers
    holds: Flags
    panels: Sequence[Panel] = ()


def plant_of(system: System) -> Plant:
    return read_plant(shipped()[system.plant]).plant


def changed(part: Part, **numbers: Any) -> Part:
    """A part of a loop with other numbers."""
    return dataclasses.replace(part, **numbers)  # type: ignore[type-var]


def numbers_of(setting: Setting, part: str) -> dict[str, jax.Array]:
    """The numbers of a part, whose names are PART.FIELD."""
    own = [name for name in setting if name.startswith(f"{part}.")]
    return {name.removeprefix(f"{part}."): jnp.asarray(setting[name]) for name in own}


def with_numbers(loop: Loop, setting: Setting, *parts: str) -> Loop:
    """The loop with the numbers of a setting in these parts."""
    own = {part: changed(getattr(loop, part), **numbers_of(setting, part)) for part in parts}
    return changed(loop, **own)


def on_plant(loop: Loop, **numbers: Any) -> Loop:
    """The loop on a plant with other numbers, which it knows."""
    plant = changed(loop.plant, **numbers)
    return changed(loop, plant=plant, nominal=plant)


def grid_of(system: System, loop: Loop) -> Timing:
    return timing(loop, system.step, system.control_period or system.step, system.duration)


def runs_of(
    system: System,
    segments: Sequence[str],
    progress: Callable[[str], None],
    words: str,
    *kinds: Sequence[Loop],
) -> list[Runs]:
    """Each kind of loops, each loop once without noise; all are computed by one program."""
    loops = [loop for kind in kinds for loop in kind]
    found = computed(loops, grid_of(system, loops[0]), 0, "", range(len(loops)), drawn=True)
    progress(words)

    def part(rows: slice) -> Runs:
        figures = {name: values[rows] for name, values in found.figures.items()}
        return Runs([*segments, "all"], figures, jax.tree.map(lambda x: x[rows], found.course))

    return [part(slice(*ends)) for ends in pairwise(accumulate(map(len, kinds), initial=0))]
