"""A start, bounds and a largest rate for the slip that another seeker asks for."""

from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp

from adhesion_jax.traction.box import Range
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.seekers.base import Peak, Seeker
from adhesion_jax.traction.signals import PerAxle, Reference, Setting, Signals

SlewedState = tuple[Any, PerAxle]


class Slewed(Seeker):
    """v* goes from `start` towards what the seeker asks for, at `rate` at most, within bounds.

    What the seeker asks for is taken as it is in size: its sign is that of the driver's demand.
    """

    seeker: Seeker
    start: Setting  # m/s
    rate: Setting  # m/s^2
    lowest: Setting  # m/s
    highest: Setting  # m/s

    @property
    def told_price(self) -> float | None:
        return self.seeker.told_price

    @property
    def box(self) -> Mapping[str, Range]:
        return {f"seeker.{name}": one for name, one in self.seeker.box.items()}

    def init(self, nominal: Plant, signals: Signals) -> SlewedState:
        return self.seeker.init(nominal, signals), jnp.zeros_like(signals.slip) + self.start

    def update(
        self, state: SlewedState, nominal: Plant, signals: Signals, period: float
    ) -> tuple[SlewedState, Reference]:
        inner, before = state
        inner, wanted = self.seeker.update(inner, nominal, signals, period)
        sign = signals.direction
        most = period * self.rate
        slip = jnp.clip(sign * wanted.slip, self.lowest, self.highest)
        slip = before + jnp.clip(slip - before, -most, most)
        return (inner, slip), Reference(sign * slip, sign * (slip - before) / period)

    def identified(self, state: SlewedState) -> Peak | None:
        return self.seeker.identified(state[0])
