"""The slip seekers of Uyulan et al. 2018: as printed, and with its slope repaired."""

from typing import ClassVar, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.traction.box import Range
from adhesion_jax.traction.filters import Differentiator
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.seekers.base import Seeker
from adhesion_jax.traction.signals import PerAxle, Reference, Setting, Signals


class PrintedState(NamedTuple):
    asked: PerAxle  # m/s
    since: Float[Array, ""]  # the last switch, s
    slip: Differentiator
    adhesion: Differentiator


class PrintedGradient(Seeker):
    """dv^ = gamma G, G = (d mu^/dt)/(d v_s/dt) where |d v_s/dt| >= eps, else 0 (Eq. 33 to 35).

    v^ = v_s at each switch, every `switch` seconds, but at the first is `start`. |G| <= limit is
    ours: the quotient has no bound. The derivatives are those of sliding-mode differentiators with
    the gain 2 r L, L that of the observer.
    """

    gamma: Setting  # m^2/s^2 per unit of adhesion
    threshold: Setting  # eps, m/s^2
    switch: Setting  # s
    start: Setting  # m/s
    gain: Setting  # L, rad/s^3
    limit: Setting  # of G, s/m

    BOX: ClassVar = {
        "gamma": Range(0.05, 5.0, log=True),
        "threshold": Range(1e-3, 1.0, log=True),
        "gain": Range(10.0, 1000.0, log=True),
    }

    def init(self, nominal: Plant, signals: Signals) -> PrintedState:
        none = jnp.zeros_like(signals.slip)
        return PrintedState(
            none + self.start,
            jnp.zeros(()),
            Differentiator(signals.slip, none),
            Differentiator(signals.adhesion, none),
        )

    def update(
        self, state: PrintedState, nominal: Plant, signals: Signals, period: float
    ) -> tuple[PrintedState, Reference]:
        gain = 2 * nominal.radius * self.gain
        slip = state.slip.after(signals.slip, gain, period)
        adhesion = state.adhesion.after(signals.adhesion, gain, period)
        moves = jnp.abs(slip.rate) >= self.threshold
        quotient = adhesion.rate / jnp.where(moves, slip.rate, 1.0)
        rate = self.gamma * jnp.where(moves, jnp.clip(quotient, -self.limit, self.limit), 0.0)
        since = state.since + period
        # A half of the period keeps the comparison clear of rounding.
        switches = since > self.switch + period / 2
        asked = jnp.where(switches, signals.slip, state.asked + period * rate)
        since = jnp.where(switches, period, since)
        return PrintedState(asked, since, slip, adhesion), Reference(asked, rate)


class RepairedState(NamedTuple):
    asked: PerAxle  # m/s
    weight: PerAxle  # forgotten sums over samples
    slip: PerAxle
    adhesion: PerAxle
    slip_slip: PerAxle
    slip_adhesion: PerAxle


class RepairedGradient(Seeker):
    """dv^ = gamma G, G the slope of adhesion over slip divided by the adhesion, |G| <= limit.

    The slope is that of the straight line of least squares through the samples, which are
    forgotten over `memory`: a quotient of two derivatives is noise where the slip rests. Slip and
    adhesion have the same lag.
    """

    gamma: Setting  # m^2/s^2
    memory: Setting  # s
    limit: Setting  # of G, s/m
    start: Setting  # m/s
    lowest: Setting  # m/s
    highest: Setting  # m/s

    BOX: ClassVar = {
        "gamma": Range(0.005, 0.5, log=True),
        "memory": Range(0.05, 1.0, log=True),
    }

    def init(self, nominal: Plant, signals: Signals) -> RepairedState:
        none = jnp.zeros_like(signals.slip)
        return RepairedState(none + self.start, none, none, none, none, none)

    def update(
        self, state: RepairedState, nominal: Plant, signals: Signals, period: float
    ) -> tuple[RepairedState, Reference]:
        sign = signals.direction
        slip, adhesion = sign * signals.slip_beside, sign * signals.adhesion
        kept = jnp.exp(-period / jnp.asarray(self.memory))
        new = (jnp.ones_like(slip), slip, adhesion, slip * slip, slip * adhesion)
        sums = [kept * old + one for old, one in zip(state[1:], new, strict=True)]
        weight, along, up, square, product = sums
        spread = weight * square - along**2
        told = spread > 1e-12 * weight**2
        slope = jnp.where(told, weight * product - along * up, 0.0) / jnp.where(told, spread, 1.0)
        relative = slope / jnp.maximum(adhesion, 0.01)
        rate = self.gamma * jnp.clip(relative, -self.limit, self.limit)
        asked = jnp.clip(state.asked + period * rate, self.lowest, self.highest)
        moved = RepairedState(asked, weight, along, up, square, product)
        return moved, Reference(sign * asked, sign * rate)
