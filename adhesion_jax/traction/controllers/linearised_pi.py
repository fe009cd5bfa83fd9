"""Proportional and integral control of slip after feedback linearisation."""

from typing import ClassVar, NamedTuple

import jax.numpy as jnp

from adhesion_jax.traction.box import Range
from adhesion_jax.traction.controllers.base import Controller, followed, torque_for
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.signals import PerAxle, Setting, Signals


class LinearisedPIState(NamedTuple):
    integral: PerAxle  # of the error, m


class LinearisedPI(Controller):
    """T = T_L + (i J/r)(dV + dv* - k z - k_i int z dt), z = v_s - v*.

    The integral stands still while the torque would leave [least, 1] of the largest.
    """

    gain: Setting  # k, 1/s
    integral_gain: Setting  # k_i, 1/s^2
    least: Setting  # torque, as a share of the largest

    BOX: ClassVar = {
        "gain": Range(5.0, 120.0, log=True),
        "integral_gain": Range(1.0, 300.0, log=True),
    }

    def init(self, nominal: Plant, signals: Signals) -> LinearisedPIState:
        return LinearisedPIState(jnp.zeros_like(signals.slip))

    def update(
        self, state: LinearisedPIState, nominal: Plant, signals: Signals, period: float
    ) -> tuple[LinearisedPIState, PerAxle]:
        asked, sign = followed(signals), signals.direction
        error = signals.slip - asked.slip
        wanted = asked.rate - self.gain * error - self.integral_gain * state.integral
        torque = sign * torque_for(nominal, signals, wanted)
        least = self.least * nominal.torque_limit
        within = (torque >= least) & (torque <= nominal.torque_limit)
        integral = state.integral + jnp.where(within, period * error, 0.0)
        return LinearisedPIState(integral), sign * jnp.maximum(torque, least)
