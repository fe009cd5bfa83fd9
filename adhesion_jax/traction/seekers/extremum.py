"""Extremum seeking with a sliding mode, of the HXD1F paper."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.seekers.base import Scalar, Seeker
from adhesion_jax.traction.signals import Reference, Signals


class ExtremumState(NamedTuple):
    level: Float[Array, " axles"]  # g, of adhesion
    asked: Float[Array, " axles"]  # v*, m/s
    slip: Float[Array, " axles"]  # behind the tracker, m/s
    rate: Float[Array, " axles"]  # m/s^2


class SlidingExtremum(Seeker):
    """s = mu^ - g, dg = rho, dv* = k sgn sin(pi s/beta), v* within bounds.

    It climbs where k |d mu/d v_s| > rho. The slip asked for is v* behind a critically damped
    tracker of the second order, which tells its rate. The equations are reconstructed: the
    source's are lost in print. Source: "Optimal Utilization of Adhesion Force ...", J. Adv.
    Transport. 2019, 6270515.
    """

    speed: Scalar  # k, m/s^2
    rise: Scalar  # rho, 1/s
    width: Scalar  # beta, of adhesion
    start: Scalar  # v*(0), m/s
    lowest: Scalar  # m/s
    highest: Scalar  # m/s
    tracker: Scalar  # rad/s

    def init(self, nominal: Plant, signals: Signals) -> ExtremumState:
        start = jnp.broadcast_to(jnp.asarray(self.start, dtype=float), signals.adhesion.shape)
        return ExtremumState(jnp.abs(signals.adhesion), start, start, jnp.zeros_like(start))

    def update(
        self, state: ExtremumState, nominal: Plant, signals: Signals, period: float
    ) -> tuple[ExtremumState, Reference]:
        # In braking all signs turn.
        sign = jnp.where(signals.demand < 0, -1.0, 1.0)
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
