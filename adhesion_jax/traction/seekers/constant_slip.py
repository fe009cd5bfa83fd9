"""One slip velocity for every rail."""

from typing import ClassVar

import jax.numpy as jnp

from adhesion_jax.traction.box import Range
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.seekers.base import Seeker
from adhesion_jax.traction.signals import Reference, Setting, Signals


class ConstantSlip(Seeker):
    """v* = slip, in m/s, with the sign of the driver's demand."""

    slip: Setting

    BOX: ClassVar = {"slip": Range(0.03, 0.3, log=True)}

    def update(
        self, state: tuple[()], nominal: Plant, signals: Signals, period: float
    ) -> tuple[tuple[()], Reference]:
        slip = self.slip * signals.direction
        return state, Reference(slip, jnp.zeros_like(slip))
