"""The slip of the largest adhesion, as the rail has it."""

from typing import ClassVar

import jax.numpy as jnp

from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.seekers.base import Seeker
from adhesion_jax.traction.signals import Reference, Signals


class TrueOptimum(Seeker):
    """What no train can know: the best that a seeker could ask for."""

    TOLD_OPTIMUM: ClassVar[bool] = True

    def init(self, nominal: Plant, signals: Signals) -> tuple[()]:
        return ()

    def update(
        self, state: tuple[()], nominal: Plant, signals: Signals, period: float
    ) -> tuple[tuple[()], Reference]:
        assert signals.optimum is not None
        return state, Reference(signals.optimum, jnp.zeros_like(signals.optimum))
