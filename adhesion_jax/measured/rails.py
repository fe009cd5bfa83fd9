"""Rails from files: the curve of an identification, the law of a discovery.

A loop asks them millions of times: what takes long to compute in a law is in tables.
"""

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PRNGKeyArray

from adhesion_jax.curves import SLIP_LIMIT, Conditions, Curve, Law, Peak, Scalar, Signal
from adhesion_jax.curves.base import SLIP_VELOCITY_LIMIT
from adhesion_jax.curves.bent import Bent, place_of
from adhesion_jax.effects.api import Value
from adhesion_jax.effects.conditions import NOMINAL_RADIUS
from adhesion_jax.effects.dynamic import Lagging
from adhesion_jax.effects.law import CorrectedLaw, Memory
from adhesion_jax.effects.one_column import Memory as ColumnMemory
from adhesion_jax.effects.saved import load_law
from adhesion_jax.effects.signals import Delay, Inertia, Lag, SlipBias, TorqueOffset
from adhesion_jax.errors import InputError
from adhesion_jax.files import METADATA
from adhesion_jax.traction.families.base import SPEED, Family
from adhesion_jax.traction.rails import ByTime, Passed, Rails, Timed, stacked
from adhesion_jax.traction.signals import Number, PerAxle
from adhesion_jax.traction.surface import RailSurface, highest, per

#: Effects of the measurement, which a train on the rail does not meet.
_OF_MEASURING = (SlipBias, TorqueOffset, Inertia, Lag, Delay)

#: Up to how many times the slip of a curve's own peak that of the curve with effects is sought.
_BEYOND = 8.0

#: Number of cubics that a departure is made of, for slips of either sign.
_CUBICS = 2048

#: Speeds of the train in m/s at which the peak of a law is sought.
_SPEEDS = np.geomspace(0.05, 150.0, 512)


class Tabulated(Law):
    """A curve and its departure, the sum of sines as cubics in the place u."""

    curve: Curve
    cubics: Float[Array, "cells powers"]  # from u = -1, of negative slips, to 1
    reach: Scalar
    largest: Scalar

    def __call__(self, slip: Signal, conditions: Conditions) -> Signal:
        place = jnp.sign(slip) * place_of(slip, self.reach, self.largest)
        cell = jnp.clip(jnp.floor(_CUBICS * place), -_CUBICS, _CUBICS - 1)
        within = _CUBICS * place - cell
        a, b, c, d = jnp.moveaxis(self.cubics[cell.astype(int) + _CUBICS], -1, 0)
        return self.curve(slip, conditions) * (1 + a + within * (b + within * (c + within * d)))


def tabulated(law: Law) -> Law:
    """The law, a departure of it in a table, each cubic of which goes through four points."""
    if not isinstance(law, Bent):
        return law
    within = np.arange(4) / 3
    places = (np.arange(-_CUBICS, _CUBICS)[:, None] + within) / _CUBICS
    width = jnp.log1p(law.largest / law.reach)
    slips = jnp.sign(places) * law.reach * jnp.expm1(jnp.abs(places) * width)
    powers = np.linalg.inv(np.vander(within, increasing=True))
    return Tabulated(law.curve, law.departure(slips) @ powers.T, law.reach, law.largest)


class Peaked(Law):
    """A law whose peak is known at some speeds of the train, and is not sought at others.

    Beyond the speeds it has the slip of the nearest.
    """

    law: Law
    peaks: Peak  # [speeds]

    def __call__(self, slip: Signal, conditions: Conditions) -> Signal:
        return self.law(slip, conditions)

    def peak(self, conditions: Conditions, slip_limit: Scalar = SLIP_LIMIT) -> Peak:
        last, speed = len(_SPEEDS) - 1, jnp.maximum(conditions["vehicle_speed_mps"], _SPEEDS[0])
        ratio = np.log(_SPEEDS[-1] / _SPEEDS[0]) / last
        place = jnp.minimum(jnp.log(speed / _SPEEDS[0]) / ratio, last)
        before = jnp.minimum(place.astype(int), last - 1)
        low, high = self.peaks.slip[before], self.peaks.slip[before + 1]
        # From one speed to the next the peak may go over to another maximum.
        slips = jnp.stack([low + (place - before) * (high - low), low, high])
        adhesion = self.law(slips, conditions)
        best = jnp.argmax(adhesion)
        found = self.peaks.found[jnp.round(place).astype(int)]
        return Peak(slips[best], adhesion[best], found)


def peaked(law: Law, slip_limit: float) -> Peaked:
    """The law, with its peaks up to a slip."""
    sought = jax.vmap(lambda speed: law.peak({"vehicle_speed_mps": speed}, slip_limit))
    return Peaked(law, sought(jnp.asarray(_SPEEDS)))


class Steady(Law):
    """A law in its steady state, whose columns but the speed of the train have one value."""

    law: CorrectedLaw
    columns: Mapping[str, Scalar]

    def __call__(self, slip: Signal, conditions: Conditions) -> Signal:
        return self.law(slip, {**self.columns, **conditions})


class Kept(NamedTuple):
    """The memory of a rail: of each axle what its effects remember."""

    time: Number  # s
    distance: Number  # m
    memory: Memory


class Remembered(Law):
    """A law at a moment, at which its memories stand still."""

    law: CorrectedLaw
    columns: Mapping[str, Scalar]
    memory: Memory  # of each axle
    end: Scalar

    def __call__(self, slip: Signal, conditions: Conditions) -> Signal:
        columns = {**self.columns, **conditions}

        def one(memory: Memory, slip: Value) -> Value:
            return self.law.step(memory, slip, columns)[1]

        each = jax.vmap(one)
        for _ in range(jnp.ndim(slip) - 1):
            each = jax.vmap(each, (None, 0))
        return each(self.memory, slip)

    def peak(self, conditions: Conditions, slip_limit: Scalar = SLIP_LIMIT) -> Peak:
        """That of the law without a lag, since what lags has no peak at a moment.

        It is sought up to the slip `end`.
        """
        prompt = tuple(effect for effect in self.law.effects if not isinstance(effect, Lagging))
        law = CorrectedLaw(self.law.curve, prompt, self.law.ranges, self.law.calendar)
        # Effects that lag are applied last, and so are their memories.
        now = Remembered(law, self.columns, self.memory[: len(prompt)], self.end)
        of_axles = jax.tree.leaves(self.memory)
        axles = len(of_axles[0]) if of_axles else 1

        def adhesion(slip: Float[Array, " axles"]) -> Float[Array, " axles"]:
            return now(slip, conditions)

        end = jnp.full(axles, self.end)
        slip = highest(adhesion, end)
        found = adhesion(slip)
        return Peak(slip, found, found > (1 + 1e-9) * adhesion(end))


class Remembering(Timed):
    """A law with effects along the whole run, those that have a memory in their step form.

    During a step of the plant the memories stand still. Each axle has its own, and all are at one
    place. Columns that a train does not change are in the middle of their ranges.
    """

    surfaces: RailSurface  # one, of a steady law
    starts: Int[Array, " segments"]
    end: Number  # the slip that the law takes up to which a peak is sought

    def init(self, slip: PerAxle, train_speed: Number) -> Kept:
        none = jnp.zeros(())
        law, columns = self._at(none, none)
        columns["vehicle_speed_mps"] = train_speed
        return Kept(
            none, none, jax.vmap(lambda one: law.init(one, columns))(self._of(slip, train_speed))
        )

    def update(self, state: Kept, passed: Passed, step: float) -> Kept:
        time, distance = state.time + step, state.distance + step * passed.train_speed
        law, columns = self._at(time, distance)
        columns["vehicle_speed_mps"] = passed.train_speed
        slip = self._of(passed.slip, passed.train_speed)
        stepped = jax.vmap(lambda memory, one: law.step(memory, one, columns)[0])
        return Kept(time, distance, stepped(state.memory, slip))

    def present(
        self, state: Kept, segment: Int[Array, ""], step: Int[Array, ""], train_speed: Number
    ) -> RailSurface:
        law = Remembered(*self._at(state.time, state.distance), state.memory, self.end)
        return RailSurface(law, self.surfaces.in_ratio)

    def _at(self, time: Number, distance: Number) -> tuple[CorrectedLaw, dict[str, Scalar]]:
        """The law and its columns but the speed, at a time and a distance since the start."""
        steady = self.surface(jnp.zeros((), dtype=int)).law
        assert isinstance(steady, Steady)
        law, columns = steady.law, dict(steady.columns)
        columns["time_s"] = time + (law.calendar.start if law.calendar.column == "time_s" else 0.0)
        columns["wheel_angle_rad"] = distance / NOMINAL_RADIUS
        if "position_m" in law.ranges:
            columns["position_m"] = law.ranges["position_m"][0] + distance
        return law, columns

    def _of(self, slip: PerAxle, train_speed: Number) -> PerAxle:
        """The slip that the law takes."""
        return slip / per(train_speed) if self.surfaces.in_ratio else slip


class LawRails(Family):
    """A law along the whole run, with what its effects remember; nothing is drawn."""

    TITLE = "a law from a file, along the whole run; all runs differ in their noise alone"
    SEGMENTS: ClassVar[int] = 1

    surface: RailSurface  # of a steady law where there are effects
    vetoes: tuple[str, ...] = eqx.field(static=True, default=())  # of the identification

    @property
    def doubt(self) -> str:
        if not self.vetoes:
            return ""
        return (
            "The points that these rails were fitted to gave no answer, so that a train may never "
            f"meet such rails: {' '.join(self.vetoes)}"
        )

    @property
    def drawn_as(self) -> str:
        """All laws have the same noise, so that they can be compared run by run."""
        return "law"

    def draw(self, key: PRNGKeyArray, step: float) -> Rails:
        law, in_ratio = self.surface.law, self.surface.in_ratio
        limit, starts = SLIP_LIMIT if in_ratio else SLIP_VELOCITY_LIMIT, jnp.zeros(1, dtype=int)
        if isinstance(law, Steady):
            quick = dataclasses.replace(law.law, curve=tabulated(law.law.curve))
            own = law.law.curve.peak({"vehicle_speed_mps": SPEED}, limit)
            steady = RailSurface(Steady(quick, law.columns), in_ratio)
            end = jnp.minimum(_BEYOND * own.slip, limit)
            return Remembering(stacked([steady]), starts, end)
        surface = RailSurface(peaked(tabulated(law), limit), in_ratio)
        return ByTime(stacked([surface]), starts)


def rails_of_curves(path: Path) -> Family:
    """The best curve of a curves.csv of `identify`, with its departure: the law.json beside it.

    InputError if one of the files is missing, or the curve has no peak.
    """
    if not path.exists():
        raise InputError(f"{path} does not exist; name the curves.csv of adhesion identify.")
    return rails_of_law(path.with_name("law.json"))


def rails_of_law(path: Path) -> Family:
    """The law in a law.json of `discover` or `identify`, without what is of the measurement.

    InputError if it has a memory without a step form, lacks the range of a column, or has no peak.
    """
    law = load_law(path)
    effects = tuple(effect for effect in law.effects if not isinstance(effect, _OF_MEASURING))
    for effect in effects:
        if isinstance(effect, ColumnMemory):
            raise InputError(
                f"{path} has {effect.FACTS.phrase.format(effect.column)}, and a train on its way "
                "cannot compute that: it has no form that goes from sample to sample; discover a "
                "law without that column."
            )
    law = CorrectedLaw(law.curve, effects, law.ranges, law.calendar)
    middle = {name: (low + high) / 2 for name, (low, high) in law.ranges.items()}
    middle.pop("vehicle_speed_mps", None)
    in_ratio, vetoes = _told_beside(path)
    surface = RailSurface(Steady(law, middle) if effects else law.curve, in_ratio)
    family = LawRails(surface, vetoes)
    rails, none, speed = family.draw(jax.random.key(0), 1e-3), jnp.asarray(0), jnp.asarray(SPEED)
    try:
        # A law looks its columns up by name, so that a missing one raises KeyError.
        first = rails.present(rails.init(jnp.zeros(1), speed), none, none, speed)
        found = first.peak(speed)
    except KeyError as missing:
        raise InputError(
            f"{path} rests on {missing.args[0]} and has no range of it; add its smallest and its "
            "largest value to the ranges of the law."
        ) from None
    if not np.all(found.found):
        reach = f"{SLIP_LIMIT:g}" if in_ratio else f"{SLIP_VELOCITY_LIMIT:g} m/s"
        raise InputError(
            f"{path} has no peak at slips up to {reach} where the train runs at {SPEED:g} m/s, so "
            "that a control has nothing to seek; name another law."
        )
    return family


def _told_beside(path: Path) -> tuple[bool, tuple[str, ...]]:
    """Whether the slip of the points was a ratio, and what forbade an answer, by the metadata."""
    beside = path.with_name(METADATA)
    try:
        told = json.loads(beside.read_text(encoding="utf-8"))
        taken = {one["taken_as"] for table in told["columns"].values() for one in table}
        vetoes = tuple(map(str, told.get("vetoes", ())))
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        raise InputError(
            f"{beside} is missing or not that of a result, so that it is not known whether "
            f"{path.name} is in slip ratio or in slip velocity; copy all files of the result."
        ) from None
    in_ratio = "slip_velocity_mps" not in taken or taken & {"slip_ratio", "vehicle_speed_mps"}
    return bool(in_ratio), vetoes
