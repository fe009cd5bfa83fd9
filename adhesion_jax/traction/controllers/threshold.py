"""Threshold logic: the torque falls while a wheel is too fast for the train, and comes back."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool

from adhesion_jax.traction.controllers.base import Controller
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.signals import PerAxle, Setting, Signals


class ThresholdState(NamedTuple):
    torque: PerAxle  # in the driver's direction, N m
    slips: Bool[Array, " axles"]


class Threshold(Controller):
    """The torque falls from |v_s| > max(`difference`, `creepage` V) on, until |v_s| is below the
    share `released` of that, and rises along a ramp otherwise.

    At low speeds the speed difference decides, at high ones the creepage.

    Fang et al. 2018 name this as the main way of today, with none of its numbers.
    """

    FOLLOWS = False

    difference: Setting  # m/s
    creepage: Setting
    released: Setting
    unloading: Setting  # shares of the largest torque in a second
    ramp: Setting  # N m/s

    def init(self, nominal: Plant, signals: Signals) -> ThresholdState:
        none = jnp.zeros_like(signals.slip)
        return ThresholdState(none, none > 0)

    def update(
        self, state: ThresholdState, nominal: Plant, signals: Signals, period: float
    ) -> tuple[ThresholdState, PerAxle]:
        limit = jnp.maximum(self.difference, self.creepage * jnp.abs(signals.train_speed))
        slip = jnp.abs(signals.slip)
        slips = (slip > limit) | (state.slips & (slip > self.released * limit))
        falls = -self.unloading * nominal.torque_limit
        torque = state.torque + period * jnp.where(slips, falls, self.ramp)
        torque = jnp.clip(torque, 0.0, jnp.abs(signals.demand))
        return ThresholdState(torque, slips), signals.direction * torque
