"""Perturb and observe: a step of slip, turned round where the adhesion fell."""

from typing import ClassVar, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.traction.box import Range
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.seekers.base import Seeker
from adhesion_jax.traction.signals import PerAxle, Reference, Setting, Signals


class PerturbState(NamedTuple):
    asked: PerAxle  # m/s
    way: PerAxle  # 1 up, -1 down
    total: PerAxle  # of the adhesion in this window
    before: PerAxle  # mean adhesion in the window before
    samples: Float[Array, ""]  # in this window


class PerturbAndObserve(Seeker):
    """v* <- v* + way step once a window; way <- -way where the mean adhesion of the window fell.

    Source: the oldest of the trackers of a largest power, such as Femia et al. 2005, IEEE Trans.
    Power Electron. 20:963-973.
    """

    step: Setting  # m/s
    window: Setting  # s
    start: Setting  # m/s
    lowest: Setting  # m/s
    highest: Setting  # m/s

    BOX: ClassVar = {"step": Range(2e-3, 0.02, log=True), "window": Range(0.02, 0.15, log=True)}

    def init(self, nominal: Plant, signals: Signals) -> PerturbState:
        none = jnp.zeros_like(signals.slip)
        return PerturbState(none + self.start, none + 1, none, none, jnp.zeros(()))

    def update(
        self, state: PerturbState, nominal: Plant, signals: Signals, period: float
    ) -> tuple[PerturbState, Reference]:
        sign = signals.direction
        total, samples = state.total + sign * signals.adhesion, state.samples + 1
        mean = total / samples
        # A half of the period keeps the comparison clear of rounding.
        due = samples * period > self.window - period / 2
        way = jnp.where(mean < state.before, -state.way, state.way)
        asked = jnp.clip(state.asked + way * self.step, self.lowest, self.highest)
        after = PerturbState(asked, way, jnp.zeros_like(total), mean, jnp.zeros(()))
        kept = state._replace(total=total, samples=samples)
        moved = PerturbState(*(jnp.where(due, a, b) for a, b in zip(after, kept, strict=True)))
        return moved, Reference(sign * moved.asked, jnp.zeros_like(total))
