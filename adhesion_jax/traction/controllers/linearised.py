"""Controllers of slip behind a feedback linearisation: a barrier, a sliding mode, and PI."""

from typing import ClassVar

import jax.numpy as jnp

from adhesion_jax.traction.box import Range
from adhesion_jax.traction.controllers.base import Controller, at_least, followed, torque_for
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.signals import PerAxle, Setting, Signals

#: Largest share of its interval that the error counts as: z/k_z is clipped to it.
_NEAREST = 0.95


class Barrier(Controller):
    """T = T_L + (i J/r)[dV + dv* - k z/(1 - z^2/k_z^2)], z = v_s - v*, k_z = kb for z > 0, else ka.

    Without noise, lag or limits z stays in (-ka, kb) (Theorem 7). The equations are reconstructed:
    the source's are lost in print. Source: "Optimal Utilization of Adhesion Force ...", J. Adv.
    Transport. 2019, 6270515.
    """

    gain: Setting = 20.0  # k, 1/s
    below: Setting = 0.1  # ka, m/s
    above: Setting = 0.3  # kb, m/s
    least: Setting = -0.3  # torque, as a share of the largest

    BOX: ClassVar = {"gain": Range(10.0, 120.0, log=True)}

    def update(
        self, state: tuple[()], nominal: Plant, signals: Signals, period: float
    ) -> tuple[tuple[()], PerAxle]:
        asked, sign = followed(signals), signals.direction
        error = sign * (signals.slip - asked.slip)
        share = error / jnp.where(error > 0, self.above, self.below)
        share = jnp.clip(share, -_NEAREST, _NEAREST)
        wanted = asked.rate - sign * self.gain * error / (1 - share**2)
        return state, at_least(self.least, nominal, signals, torque_for(nominal, signals, wanted))


class SlidingMode(Controller):
    """T = T_L + (i J/r)(dV + dv*) - gain sat(z/layer), z = v_s - v*; a layer of 0 is the sign."""

    gain: Setting = 1500.0  # N m
    layer: Setting = 0.0  # m/s
    least: Setting = -0.3  # torque, as a share of the largest

    BOX: ClassVar = {
        "gain": Range(300.0, 6000.0, log=True),
        "layer": Range(0.01, 0.2, log=True),
    }

    def update(
        self, state: tuple[()], nominal: Plant, signals: Signals, period: float
    ) -> tuple[tuple[()], PerAxle]:
        asked = followed(signals)
        error = signals.slip - asked.slip
        switched = self.gain * jnp.clip(error / jnp.maximum(self.layer, 1e-12), -1.0, 1.0)
        torque = torque_for(nominal, signals, asked.rate) - switched
        return state, at_least(self.least, nominal, signals, torque)


class LinearisedPI(Controller):
    """T = T_L + (i J/r)(dV + dv* - k z - k_i int z dt), z = v_s - v*.

    The integral stands still while the torque would leave [least, 1] of the largest.
    """

    gain: Setting = 20.0  # k, 1/s
    integral_gain: Setting = 20.0  # k_i, 1/s^2
    least: Setting = -0.2  # torque, as a share of the largest

    BOX: ClassVar = {
        "gain": Range(5.0, 120.0, log=True),
        "integral_gain": Range(1.0, 300.0, log=True),
    }

    def init(self, nominal: Plant, signals: Signals) -> PerAxle:
        """The integral of the error, m s."""
        return jnp.zeros_like(signals.slip)

    def update(
        self, state: PerAxle, nominal: Plant, signals: Signals, period: float
    ) -> tuple[PerAxle, PerAxle]:
        asked = followed(signals)
        error = signals.slip - asked.slip
        wanted = asked.rate - self.gain * error - self.integral_gain * state
        torque = torque_for(nominal, signals, wanted)
        ahead, limit = signals.direction * torque, nominal.torque_limit
        within = (ahead >= self.least * limit) & (ahead <= limit)
        integral = state + jnp.where(within, period * error, 0.0)
        return integral, at_least(self.least, nominal, signals, torque)
