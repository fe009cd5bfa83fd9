"""A curve with the effects that were found: an ordinary law."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp

from adhesion_jax.curves import NO_CONDITIONS, Conditions, Law, Scalar, Signal
from adhesion_jax.curves.precision import precise_of_numbers
from adhesion_jax.effects.api import Effect, Value
from adhesion_jax.effects.conditions import Calendar, completed
from adhesion_jax.effects.dynamic import Dynamic
from adhesion_jax.effects.one_column import Periodic, turn_of
from adhesion_jax.effects.shape import exponents_of, shaped

#: The memory of each effect of a law, in the order in which they are applied.
Memory = tuple[Any, ...]


class CorrectedLaw(Law):
    """A curve and the effects on top of it, in the order of their ORDER.

    Conditions are the measured columns, scalars for a steady state or arrays [points] of one whole
    run in the order of time.

    Attributes:
        curve: the base curve.
        effects: those that were found.
        ranges: by column, the smallest and the largest value of the data it was found in; effects
            see no value outside them, unless it is cyclic.
        calendar: which column of time the campaign has.
        slip: what its slip is, slip_ratio or slip_velocity_mps.
    """

    curve: Law
    effects: tuple[Effect, ...]
    ranges: Mapping[str, tuple[Scalar, Scalar]]
    calendar: Calendar = eqx.field(static=True)
    slip: str = eqx.field(static=True, default="slip_ratio")

    @precise_of_numbers
    def __call__(self, slip: Signal, conditions: Conditions = NO_CONDITIONS) -> Signal:
        return with_effects(self.curve, self.effects, slip, self._seen(slip, conditions))

    def init(self, slip: Value, conditions: Conditions) -> Memory:
        """What the effects remember at the first sample of a run, for `step`."""
        return self._advanced(None, slip, conditions)[0]

    def step(self, memory: Memory, slip: Value, conditions: Conditions) -> tuple[Memory, Value]:
        """The memory after one more sample, the first included, and its adhesion.

        Conditions are scalars. Over the samples of a run it gives what a call with the whole run
        gives, to the first order in the time between samples. Conditions that follow from a whole
        run (acceleration_mps2, wheel_angle_rad) must be given if an effect needs them.
        """
        return self._advanced(memory, slip, conditions)

    def _advanced(
        self, memory: Memory | None, slip: Value, conditions: Conditions
    ) -> tuple[Memory, Value]:
        seen = self._seen(slip, conditions)
        effects = sorted(self.effects, key=lambda effect: effect.ORDER)
        adhesion = _at_contact(self.curve, effects, slip, seen)
        after: list[Any] = []
        for place, effect in enumerate(effects):
            if isinstance(effect, Dynamic):
                before = effect.init(adhesion, slip, seen) if memory is None else memory[place]
                remembered, adhesion = effect.step(before, adhesion, slip, seen)
            else:
                remembered, adhesion = None, effect.after(adhesion, slip, seen)
            after.append(remembered)
        return tuple(after), adhesion

    def _seen(self, slip: Signal, conditions: Conditions) -> Conditions:
        """The conditions, those that follow from them, and none outside the ranges."""
        whole = completed(slip, conditions, self.calendar)
        ranges = {name: one for name, one in self.ranges.items() if name not in self.cyclic}
        return {
            name: jnp.clip(values, *ranges[name]) if name in ranges else values
            for name, values in whole.items()
        }

    @property
    def cyclic(self) -> set[str]:
        """Columns that begin anew, as the hour, of effects that do so alone: they have no edge."""
        waves = {one.column for one in self.effects if isinstance(one, Periodic)}
        others = (one for one in self.effects if not isinstance(one, Periodic))
        fields = (getattr(one, field.name) for one in others for field in dataclasses.fields(one))
        rested_on = {name for name in fields if isinstance(name, str)}
        return {column for column in waves - rested_on if turn_of(column)}


def with_effects(
    curve: Law, effects: tuple[Effect, ...], slip: Signal, conditions: Conditions
) -> Signal:
    """Adhesion of the curve under the effects, applied from the contact outwards."""
    inner_first = sorted(effects, key=lambda effect: effect.ORDER)
    adhesion = _at_contact(curve, inner_first, slip, conditions)
    for effect in inner_first:
        adhesion = effect.after(adhesion, slip, conditions)
    return adhesion


def _at_contact(
    curve: Law, inner_first: Sequence[Effect], slip: Signal, conditions: Conditions
) -> Signal:
    """The curve at the slip that the effects have bent, its shape bent by those on columns."""
    bent = slip
    for effect in reversed(inner_first):
        bent = effect.before(bent, conditions)
    exponents = exponents_of(inner_first, conditions)
    return shaped(lambda slip: curve(slip, conditions), bent, exponents)
