"""Torque feedback of the adhesion observed: Fang et al. 2018, Eq. 9, and Eq. 8 before it."""

from typing import ClassVar, NamedTuple

import jax.numpy as jnp

from adhesion_jax.optim.kalman import slope_step
from adhesion_jax.traction.box import Range
from adhesion_jax.traction.controllers.base import Controller
from adhesion_jax.traction.filters import lagged
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.signals import PerAxle, Setting, Signals


class SlopeFeedbackState(NamedTuple):
    theta: PerAxle  # d mu/d v_s by the recursion, s/m
    p: PerAxle
    slope: PerAxle  # filtered
    slip: PerAxle  # at the last sample
    adhesion: PerAxle


class SlopeFeedback(Controller):
    """T = sgn T* min(|T*|, max(0, K1 beta + K2 |mu^|)), beta the slope d mu/d v_s (Eq. 9).

    The slope is that of recursive least squares (Eq. 11) through the differences of adhesion and
    slip from sample to sample, both with the lag of the observer, kept within +- 1 s/m and then
    filtered. It needs no seeker: K2 decides the slip at which it settles.
    """

    FOLLOWS = False

    slope_gain: Setting = 19000.0  # K1, N m^2/s
    adhesion_gain: Setting = 18000.0  # K2, N m
    gamma: Setting = 10.0  # s^4/m^2
    first_p: Setting = 10.0
    first_slope: Setting = 0.3  # s/m; at 0 a train at rest never starts
    filter_time: Setting = 0.05  # s

    BOX: ClassVar = {
        "slope_gain": Range(300.0, 6e4, log=True),
        "adhesion_gain": Range(1.5e4, 3.2e4),
        "filter_time": Range(0.005, 0.1, log=True),
    }

    def init(self, nominal: Plant, signals: Signals) -> SlopeFeedbackState:
        none = jnp.zeros_like(signals.slip)
        slope = none + self.first_slope
        return SlopeFeedbackState(
            slope, none + self.first_p, slope, signals.slip_beside, signals.adhesion
        )

    def update(
        self, state: SlopeFeedbackState, nominal: Plant, signals: Signals, period: float
    ) -> tuple[SlopeFeedbackState, PerAxle]:
        rise = (signals.adhesion - state.adhesion) / period
        run = (signals.slip_beside - state.slip) / period
        found = slope_step(state.theta, state.p, rise, run, jnp.asarray(self.gamma))
        theta = jnp.clip(found.theta, -1.0, 1.0)
        slope = lagged(state.slope, theta, self.filter_time, period)
        torque = self.slope_gain * slope + self.adhesion_gain * jnp.abs(signals.adhesion)
        moved = SlopeFeedbackState(theta, found.p, slope, signals.slip_beside, signals.adhesion)
        return moved, signals.direction * jnp.maximum(torque, 0.0)


class RateFeedbackState(NamedTuple):
    rate: PerAxle  # d|mu^|/dt, filtered, 1/s
    adhesion: PerAxle  # |mu^| at the last sample


class RateFeedback(Controller):
    """T = sgn T* min(|T*|, max(0, K1 d|mu^|/dt + K2 |mu^| + C)) (Eq. 8), from a speed on.

    C is the open-loop torque of the method that Fang et al. start from, constant here. Without it
    mu = 0 asks for no torque at rest and the train never starts: below `engaged` the driver's
    demand stands.
    """

    FOLLOWS = False

    rate_gain: Setting = 19000.0  # K1, N m s
    adhesion_gain: Setting = 18000.0  # K2, N m
    filter_time: Setting = 0.05  # s
    engaged: Setting = 30 / 3.6  # m/s
    open_loop: Setting = 0.0  # C, N m

    def init(self, nominal: Plant, signals: Signals) -> RateFeedbackState:
        return RateFeedbackState(jnp.zeros_like(signals.slip), jnp.abs(signals.adhesion))

    def update(
        self, state: RateFeedbackState, nominal: Plant, signals: Signals, period: float
    ) -> tuple[RateFeedbackState, PerAxle]:
        adhesion = jnp.abs(signals.adhesion)
        rise = (adhesion - state.adhesion) / period
        rate = lagged(state.rate, rise, self.filter_time, period)
        torque = self.rate_gain * rate + self.adhesion_gain * adhesion + self.open_loop
        torque = jnp.maximum(torque, 0.0)
        engaged = signals.train_speed >= self.engaged
        command = jnp.where(engaged, signals.direction * torque, signals.demand)
        return RateFeedbackState(rate, adhesion), command
