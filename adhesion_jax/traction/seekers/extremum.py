"""Extremum seeking with a sliding mode, of the HXD1F paper."""

from typing import ClassVar, NamedTuple

import jax.numpy as jnp

from adhesion_jax.traction.box import Range
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.seekers.base import Seeker
from adhesion_jax.traction.signals import PerAxle, Reference, Setting, Signals


class ExtremumState(NamedTuple):
    level: PerAxle  # g, of adhesion
    asked: PerAxle  # v*, m/s
    slip: PerAxle  # behind the tracker, m/s
    rate: PerAxle  # m/s^2


class SlidingExtremum(Seeker):
    """s = mu^ - g, dg = rho, dv* = k sgn sin(pi s/beta), v* within bounds.

    It climbs where k |d mu/d v_s| > rho. The slip asked for is v* behind a critically damped
    tracker of the second order, which tells its rate. The equations are reconstructed: the
    source's are lost in print. Source: "Optimal Utilization of Adhesion Force ...", J. Adv.
    Transport. 2019, 6270515.
    """

    speed: Setting  # k, m/s^2
    rise: Setting  # rho, 1/s
    width: Setting  # beta, of adhesion
    start: Setting  # v*(0), m/s
    lowest: Setting  # m/s
    highest: Setting  # m/s
    tracker: Setting  # rad/s

    BOX: ClassVar = {
        "speed": Range(0.05, 1.0, log=True),
        "rise": Range(0.05, 2.0, log=True),
        "width": Range(0.01, 0.2, log=True),
    }

    def init(self, nominal: Plant, signals: Signals) -> ExtremumState:
        start = jnp.broadcast_to(jnp.asarray(self.start, dtype=float), signals.adhesion.shape)
        return ExtremumState(jnp.abs(signals.adhesion), start, start, jnp.zeros_like(start))

    def update(
        self, state: ExtremumState, nominal: Plant, signals: Signals, period: float
    ) -> tuple[ExtremumState, Reference]:
        # In braking all signs turn.
        sign = signals.direction
        error = sign * signals.adhesion - state.level
        # sgn sin(pi s/beta) is the parity of the cell of s, and 0 at the start; it costs no sine.
        parity = jnp.where(jnp.floor(error / self.width) % 2 == 0, 1.0, -1.0)
        climbing = jnp.where(error == 0, 0.0, self.speed * parity)
        asked = jnp.clip(state.asked + period * climbing, self.lowest, self.highest)
        # Over a period the tracker's answer to what it is given is exact.
        behind = state.slip - asked
        turning = state.rate + self.tracker * behind
        kept = jnp.exp(-self.tracker * period)
        slip = asked + kept * (behind + period * turning)
        rate = kept * (state.rate - self.tracker * period * turning)
        moved = ExtremumState(state.level + period * self.rise, asked, slip, rate)
        return moved, Reference(sign * slip, sign * rate)
