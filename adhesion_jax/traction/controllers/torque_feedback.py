"""Torque feedback of the adhesion observed: Fang et al. 2018, Eq. 9, and Eq. 8 before it."""

from typing import ClassVar, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.optim.recursive_slope import slope_step
from adhesion_jax.traction.controllers.base import Controller, Scalar, direction
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.signals import Reference, Signals


class SlopeFeedbackState(NamedTuple):
    theta: Float[Array, " axles"]  # d mu/d v_s by the recursion, s/m
    p: Float[Array, " axles"]
    slope: Float[Array, " axles"]  # filtered
    slip: Float[Array, " axles"]  # at the last sample
    adhesion: Float[Array, " axles"]


class SlopeFeedback(Controller):
    """T = sgn T* min(|T*|, max(0, K1 beta + K2 |mu^|)), beta the slope d mu/d v_s (Eq. 9).

    The slope is that of recursive least squares (Eq. 11) through the differences of adhesion and
    slip from sample to sample, both with the lag of the observer, kept within +- 1 s/m and then
    filtered. It needs no seeker: K2 decides the slip at which it settles.
    """

    FOLLOWS: ClassVar[bool] = False

    slope_gain: Scalar  # K1, N m^2/s
    adhesion_gain: Scalar  # K2, N m
    gamma: Scalar  # s^4/m^2
    first_p: Scalar
    first_slope: Scalar  # s/m; at 0 a train at rest never starts
    filter_time: Scalar  # s

    def init(self, nominal: Plant, signals: Signals) -> SlopeFeedbackState:
        none = jnp.zeros_like(signals.slip)
        slope = none + self.first_slope
        return SlopeFeedbackState(
            slope, none + self.first_p, slope, signals.slip_beside, signals.adhesion
        )

    def update(
        self,
        state: SlopeFeedbackState,
        nominal: Plant,
        signals: Signals,
        reference: Reference | None,
        period: float,
    ) -> tuple[SlopeFeedbackState, Float[Array, " axles"]]:
        rise = (signals.adhesion - state.adhesion) / period
        run = (signals.slip_beside - state.slip) / period
        found = slope_step(state.theta, state.p, rise, run, jnp.asarray(self.gamma))
        theta = jnp.clip(found.theta, -1.0, 1.0)
        slope = state.slope - jnp.expm1(-period / self.filter_time) * (theta - state.slope)
        torque = self.slope_gain * slope + self.adhesion_gain * jnp.abs(signals.adhesion)
        moved = SlopeFeedbackState(theta, found.p, slope, signals.slip_beside, signals.adhesion)
        return moved, direction(signals) * jnp.maximum(torque, 0.0)


class RateFeedbackState(NamedTuple):
    rate: Float[Array, " axles"]  # d|mu^|/dt, filtered, 1/s
    adhesion: Float[Array, " axles"]  # |mu^| at the last sample


class RateFeedback(Controller):
    """T = sgn T* min(|T*|, max(0, K1 d|mu^|/dt + K2 |mu^|)) (Eq. 8), from a speed on.

    At rest mu = 0 asks for no torque and the train never starts: below `engaged` the driver's
    demand stands.
    """

    FOLLOWS: ClassVar[bool] = False

    rate_gain: Scalar  # K1, N m s
    adhesion_gain: Scalar  # K2, N m
    filter_time: Scalar  # s
    engaged: Scalar  # m/s

    def init(self, nominal: Plant, signals: Signals) -> RateFeedbackState:
        return RateFeedbackState(jnp.zeros_like(signals.slip), jnp.abs(signals.adhesion))

    def update(
        self,
        state: RateFeedbackState,
        nominal: Plant,
        signals: Signals,
        reference: Reference | None,
        period: float,
    ) -> tuple[RateFeedbackState, Float[Array, " axles"]]:
        adhesion = jnp.abs(signals.adhesion)
        rise = (adhesion - state.adhesion) / period
        rate = state.rate - jnp.expm1(-period / self.filter_time) * (rise - state.rate)
        torque = jnp.maximum(self.rate_gain * rate + self.adhesion_gain * adhesion, 0.0)
        engaged = signals.train_speed >= self.engaged
        command = jnp.where(engaged, direction(signals) * torque, signals.demand)
        return RateFeedbackState(rate, adhesion), command
