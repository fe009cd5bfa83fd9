"""A sliding mode controller of slip, with and without a boundary layer."""

from typing import ClassVar

import jax.numpy as jnp

from adhesion_jax.traction.box import Range
from adhesion_jax.traction.controllers.base import Controller, followed, torque_for
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.signals import PerAxle, Setting, Signals


class SlidingMode(Controller):
    """T = T_L + (i J/r)(dV + dv*) - gain sat(z/layer), z = v_s - v*; a layer of 0 is the sign."""

    gain: Setting  # N m
    layer: Setting  # m/s
    least: Setting  # torque, as a share of the largest

    BOX: ClassVar = {
        "gain": Range(300.0, 6000.0, log=True),
        "layer": Range(0.01, 0.2, log=True),
    }

    def update(
        self, state: tuple[()], nominal: Plant, signals: Signals, period: float
    ) -> tuple[tuple[()], PerAxle]:
        asked, sign = followed(signals), signals.direction
        error = signals.slip - asked.slip
        switched = self.gain * jnp.clip(error / jnp.maximum(self.layer, 1e-12), -1.0, 1.0)
        torque = sign * (torque_for(nominal, signals, asked.rate) - switched)
        return state, sign * jnp.maximum(torque, self.least * nominal.torque_limit)
