"""The true slip of the largest adhesion, or of the largest gain where slip has its price."""

import equinox as eqx
import jax.numpy as jnp

from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.seekers.base import Seeker
from adhesion_jax.traction.signals import Reference, Signals


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
