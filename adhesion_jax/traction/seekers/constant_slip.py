"""One slip velocity for every rail."""

import jax.numpy as jnp

from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.seekers.base import Scalar, Seeker
from adhesion_jax.traction.signals import Reference, Signals


class ConstantSlip(Seeker):
    """v* = slip, in m/s, with the sign of the driver's demand."""

    slip: Scalar

    def init(self, nominal: Plant, signals: Signals) -> tuple[()]:
        return ()

    def update(
        self, state: tuple[()], nominal: Plant, signals: Signals, period: float
    ) -> tuple[tuple[()], Reference]:
        slip = self.slip * jnp.where(signals.demand < 0, -1.0, 1.0)
        return state, Reference(slip, jnp.zeros_like(slip))
