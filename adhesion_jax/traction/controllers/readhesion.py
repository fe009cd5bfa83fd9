"""Control of the torque alone: none, threshold logic, and differential acceleration control."""

from typing import ClassVar, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from adhesion_jax.traction.box import Range
from adhesion_jax.traction.controllers.base import Controller
from adhesion_jax.traction.filters import lagged
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.signals import PerAxle, Setting, Signals


class NoControl(Controller):
    """T = T*."""

    FOLLOWS = False

    def update(
        self, state: tuple[()], nominal: Plant, signals: Signals, period: float
    ) -> tuple[tuple[()], PerAxle]:
        return state, signals.demand


class ThresholdState(NamedTuple):
    torque: PerAxle  # in the driver's direction, N m
    slips: Bool[Array, " axles"]


class Threshold(Controller):
    """The torque falls from |v_s| > max(`difference`, `creepage` V) on, until |v_s| is below the
    share `released` of that, and rises along a ramp otherwise.

    At low speeds the speed difference decides, at high ones the creepage.

    Fang et al. 2018 name this as the main way of today, with none of its numbers.
    """

    FOLLOWS = False

    difference: Setting = 0.8  # m/s
    creepage: Setting = 0.05
    released: Setting = 0.3
    unloading: Setting = 4.0  # shares of the largest torque in a second
    ramp: Setting = 1600.0  # N m/s

    def init(self, nominal: Plant, signals: Signals) -> ThresholdState:
        none = jnp.zeros_like(signals.slip)
        return ThresholdState(none, none > 0)

    def update(
        self, state: ThresholdState, nominal: Plant, signals: Signals, period: float
    ) -> tuple[ThresholdState, PerAxle]:
        limit = jnp.maximum(self.difference, self.creepage * jnp.abs(signals.train_speed))
        slip = jnp.abs(signals.slip)
        slips = (slip > limit) | (state.slips & (slip > self.released * limit))
        falls = -self.unloading * nominal.torque_limit
        torque = state.torque + period * jnp.where(slips, falls, self.ramp)
        torque = jnp.clip(torque, 0.0, jnp.abs(signals.demand))
        return ThresholdState(torque, slips), signals.direction * torque


_RAISING, _UNLOADING, _HOLDING, _RECOVERING = 0, 1, 2, 3


class DifferentialAccelerationState(NamedTuple):
    phase: Int[Array, " axles"]
    torque: PerAxle  # in the driver's direction, N m
    at_trip: PerAxle  # N m
    held: PerAxle  # s
    rim: PerAxle  # speed of the wheel at its rim at the last sample, m/s
    gaining: PerAxle  # wheel acceleration less that of the train, filtered, m/s^2


class DifferentialAcceleration(Controller):
    """The torque rises along a ramp until d = dv_wheel - dV, filtered, exceeds `trip`; it is
    unloaded until d < -`released`, held for a time at least and until |d| < `calm`, and recovers,
    at `haste` times the ramp, to min(`back` T_trip, max(T, T_L)), from where the ramp goes on.

    The HXD1F paper compares with this method and gives none of its numbers: all are assumed.
    """

    FOLLOWS = False

    ramp: Setting = 12e3  # N m/s
    trip: Setting = 1.0  # m/s^2
    released: Setting = 0.3  # m/s^2
    calm: Setting = 0.2  # m/s^2
    unloading: Setting = 6.0  # shares of the largest torque in a second
    hold: Setting = 0.1  # s
    haste: Setting = 3.0
    back: Setting = 0.85
    least: Setting = -0.15  # torque, as a share of the largest
    filter_time: Setting = 0.01  # s

    BOX: ClassVar = {
        "ramp": Range(4e3, 6e4, log=True),
        "trip": Range(0.3, 5.0, log=True),
        "unloading": Range(2.0, 30.0, log=True),
        "hold": Range(0.02, 0.3, log=True),
        "back": Range(0.6, 0.98),
    }

    def init(self, nominal: Plant, signals: Signals) -> DifferentialAccelerationState:
        none = jnp.zeros_like(signals.slip)
        rim = nominal.circumferential(signals.motor_speed)
        return DifferentialAccelerationState(
            jnp.zeros_like(none, dtype=int), none, none, none, rim, none
        )

    def update(
        self, state: DifferentialAccelerationState, nominal: Plant, signals: Signals, period: float
    ) -> tuple[DifferentialAccelerationState, PerAxle]:
        sign = signals.direction
        rim = nominal.circumferential(signals.motor_speed)
        train = nominal.acceleration(signals.adhesion, signals.train_speed)
        gaining = sign * ((rim - state.rim) / period - train)
        gaining = lagged(state.gaining, gaining, self.filter_time, period)

        load = sign * signals.load
        goal = jnp.minimum(self.back * state.at_trip, jnp.maximum(state.torque, load))
        # Also while it holds: otherwise a rail that gets worse then would not be noticed.
        trips = (gaining > self.trip) & (state.phase != _UNLOADING)
        rests = (state.phase == _UNLOADING) & (gaining < -self.released)
        calms = (state.phase == _HOLDING) & (state.held >= self.hold)
        calms = calms & (jnp.abs(gaining) < self.calm)
        there = (state.phase == _RECOVERING) & (state.torque >= goal)
        phase = jnp.where(there, _RAISING, state.phase)
        phase = jnp.where(calms, _RECOVERING, phase)
        phase = jnp.where(rests, _HOLDING, phase)
        phase = jnp.where(trips, _UNLOADING, phase)

        rising = period * self.ramp
        torque = state.torque + jnp.where(phase == _RAISING, rising, 0.0)
        recovered = jnp.minimum(state.torque + self.haste * rising, jnp.maximum(goal, state.torque))
        torque = jnp.where(phase == _RECOVERING, recovered, torque)
        unloaded = state.torque - period * self.unloading * nominal.torque_limit
        torque = jnp.where(phase == _UNLOADING, unloaded, torque)
        torque = jnp.clip(torque, self.least * nominal.torque_limit, jnp.abs(signals.demand))
        moved = DifferentialAccelerationState(
            phase,
            torque,
            jnp.where(trips, state.torque, state.at_trip),
            jnp.where(phase == _HOLDING, state.held + period, 0.0),
            rim,
            gaining,
        )
        return moved, sign * torque
