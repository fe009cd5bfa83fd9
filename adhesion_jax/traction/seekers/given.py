"""Slips that nobody seeks: one for every rail, and the true optimum."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from adhesion_jax.traction.box import Range
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.seekers.base import Seeker
from adhesion_jax.traction.signals import Reference, Setting, Signals


class ConstantSlip(Seeker):
    """v* = slip, in m/s, with the sign of the driver's demand."""

    slip: Setting = 0.1

    BOX: ClassVar = {"slip": Range(0.03, 0.3, log=True)}

    def update(
        self, state: tuple[()], nominal: Plant, signals: Signals, period: float
    ) -> tuple[tuple[()], Reference]:
        slip = self.slip * signals.direction
        return state, Reference(slip, jnp.zeros_like(slip))


class TrueOptimum(Seeker):
    """The slip of the largest mu(v) (V - price v) at this moment, which no train can measure.

    A joule that is lost in the contact costs as much as `price` joules of useful work.
    """

    price: float = eqx.field(default=0.0, static=True)

    @property
    def told_price(self) -> float | None:
        return self.price

    def update(
        self, state: tuple[()], nominal: Plant, signals: Signals, period: float
    ) -> tuple[tuple[()], Reference]:
        assert signals.optimum is not None
        return state, Reference(signals.optimum, jnp.zeros_like(signals.optimum))
