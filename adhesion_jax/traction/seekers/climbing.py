"""Seekers that climb the adhesion observed: by steps, by a sliding mode, and by its slope."""

from typing import ClassVar, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.traction.box import Range
from adhesion_jax.traction.filters import Differentiator
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

    step: Setting = 0.006  # m/s
    window: Setting = 0.05  # s
    start: Setting = 0.1  # m/s
    lowest: Setting = 0.01  # m/s
    highest: Setting = 0.6  # m/s

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

    speed: Setting = 0.4  # k, m/s^2
    rise: Setting = 0.5  # rho, 1/s
    width: Setting = 0.08  # beta, of adhesion
    start: Setting = 0.01  # v*(0), m/s
    lowest: Setting = 0.005  # m/s
    highest: Setting = 0.6  # m/s
    tracker: Setting = 60.0  # rad/s

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


class PrintedState(NamedTuple):
    asked: PerAxle  # m/s
    since: Float[Array, ""]  # the last switch, s
    slip: Differentiator
    adhesion: Differentiator


class PrintedGradient(Seeker):
    """dv^ = gamma G, G = (d mu^/dt)/(d v_s/dt) where |d v_s/dt| >= eps, else 0.

    The seeker of Uyulan et al. 2018 as printed (Eq. 33 to 35). v^ = v_s at each switch, every
    `switch` seconds, but at the first is `start`. |G| <= limit is ours: the quotient has no bound.
    The derivatives are those of sliding-mode differentiators with the gain 2 r L, L that of the
    observer.
    """

    gamma: Setting = 0.65  # m^2/s^2 per unit of adhesion
    threshold: Setting = 1e-4  # eps, m/s^2
    switch: Setting = 10.0  # s
    start: Setting = 1.20986  # m/s
    gain: Setting = 400.0  # L, rad/s^3
    limit: Setting = 1.0  # of G, s/m

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
        sign, gain = signals.direction, 2 * nominal.radius * self.gain
        slip = state.slip.after(signals.slip, gain, period)
        adhesion = state.adhesion.after(signals.adhesion, gain, period)
        moves = jnp.abs(slip.rate) >= self.threshold
        quotient = adhesion.rate / jnp.where(moves, slip.rate, 1.0)
        rate = self.gamma * jnp.where(moves, jnp.clip(quotient, -self.limit, self.limit), 0.0)
        since = state.since + period
        # A half of the period keeps the comparison clear of rounding.
        switches = since > self.switch + period / 2
        asked = jnp.where(switches, sign * signals.slip, state.asked + period * rate)
        since = jnp.where(switches, period, since)
        return PrintedState(asked, since, slip, adhesion), Reference(sign * asked, sign * rate)


class RepairedState(NamedTuple):
    asked: PerAxle  # m/s
    weight: PerAxle  # forgotten sums over samples
    slip: PerAxle
    adhesion: PerAxle
    slip_slip: PerAxle
    slip_adhesion: PerAxle


class RepairedGradient(Seeker):
    """dv^ = gamma G, G the slope of adhesion over slip divided by the adhesion, |G| <= limit.

    The same with its slope repaired: that of the straight line of least squares through the
    samples, which are forgotten over `memory`. A quotient of two derivatives is noise where the
    slip rests. Slip and adhesion have the same lag.
    """

    gamma: Setting = 0.05  # m^2/s^2
    memory: Setting = 0.3  # s
    limit: Setting = 20.0  # of G, s/m
    start: Setting = 0.05  # m/s
    lowest: Setting = 0.005  # m/s
    highest: Setting = 2.0  # m/s

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
