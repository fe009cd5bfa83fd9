"""The true slip of the largest adhesion."""

import jax.numpy as jnp

from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.seekers.base import Seeker
from adhesion_jax.traction.signals import Reference, Signals


class TrueOptimum(Seeker):
    """The best slip that a seeker could ask for, which no train can measure."""

    TOLD_OPTIMUM = True

    def update(
        self, state: tuple[()], nominal: Plant, signals: Signals, period: float
    ) -> tuple[tuple[()], Reference]:
        assert signals.optimum is not None
        return state, Reference(signals.optimum, jnp.zeros_like(signals.optimum))
