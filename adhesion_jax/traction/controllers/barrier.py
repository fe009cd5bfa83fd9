"""The controller of the HXD1F paper: an asymmetric barrier Lyapunov function."""

from typing import ClassVar

import jax.numpy as jnp

from adhesion_jax.traction.box import Range
from adhesion_jax.traction.controllers.base import Controller, followed, torque_for
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

    gain: Setting  # k, 1/s
    below: Setting  # ka, m/s
    above: Setting  # kb, m/s
    least: Setting  # torque, as a share of the largest

    BOX: ClassVar = {"gain": Range(10.0, 120.0, log=True)}

    def update(
        self, state: tuple[()], nominal: Plant, signals: Signals, period: float
    ) -> tuple[tuple[()], PerAxle]:
        asked, sign = followed(signals), signals.direction
        error = sign * (signals.slip - asked.slip)
        share = error / jnp.where(error > 0, self.above, self.below)
        share = jnp.clip(share, -_NEAREST, _NEAREST)
        wanted = asked.rate - sign * self.gain * error / (1 - share**2)
        torque = sign * torque_for(nominal, signals, wanted)
        return state, sign * jnp.maximum(torque, self.least * nominal.torque_limit)
