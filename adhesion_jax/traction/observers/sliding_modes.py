"""Observers by sliding modes of the second order: super-twisting and nonsingular terminal."""

from typing import ClassVar, NamedTuple

import jax.numpy as jnp

from adhesion_jax.traction.box import Range
from adhesion_jax.traction.filters import pull
from adhesion_jax.traction.observers.base import Observer
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.signals import Measurement, PerAxle, Setting


class SuperTwistingState(NamedTuple):
    speed: PerAxle  # rad/s
    deceleration: PerAxle  # by the load, rad/s^2
    slip: PerAxle  # m/s
    load: PerAxle  # N m


class SuperTwisting(Observer):
    """dw^ = T/J - z + 1.5 sqrt(G) |e|^(1/2) sgn e, dz = -1.1 G sgn e, e = w - w^, T_L = J z.

    z is taken at the end of the step. G = i L, L the gain at the wheel in rad/s^3, which is to be
    above the largest |d^2 w_wheel/dt^2|. It chatters with the step, and is bounded at any. Uyulan
    et al. 2018 name the observer without its equations; these are those of Levant 1998,
    Automatica 34.
    """

    gain: Setting = 400.0

    BOX: ClassVar = {"gain": Range(30.0, 3000.0, log=True)}

    def init(self, nominal: Plant, measured: Measurement) -> SuperTwistingState:
        none = jnp.zeros_like(measured.motor_speed)
        return SuperTwistingState(measured.motor_speed, none, measured.slip, none)

    def update(
        self,
        state: SuperTwistingState,
        nominal: Plant,
        measured: Measurement,
        torque: PerAxle,
        step: float,
    ) -> SuperTwistingState:
        gain = nominal.gear_ratio * self.gain
        error = measured.motor_speed - state.speed
        deceleration = state.deceleration - step * 1.1 * gain * jnp.sign(error)
        turning = torque / nominal.inertia - deceleration + pull(error, gain)
        return SuperTwistingState(
            state.speed + step * turning,
            deceleration,
            measured.slip,
            nominal.inertia * deceleration,
        )


class TerminalSlidingState(NamedTuple):
    speed: PerAxle  # rad/s
    push: PerAxle  # u, rad/s^2
    error: PerAxle  # at the step before, rad/s
    load: PerAxle  # N m
    slip: PerAxle  # m/s


class TerminalSliding(Observer):
    """dw^ = T/J + u, T_L = -J u; e = w - w^, s = lambda e + |de/dt|^(5/3) sgn(de/dt)/beta,
    du/dt = (3/5) lambda beta |de/dt|^(1/3) sgn(de/dt) + K sgn s.

    de/dt is the backward difference over a step, and u is taken at its end: w^ by the u before it
    chatters at the step. The equations are reconstructed: the source's are lost in print. Source:
    "Optimal Utilization of Adhesion Force ...", J. Adv. Transport. 2019, 6270515, Eq. 20.
    """

    surface_gain: Setting = 100.0  # lambda, of e
    rate_gain: Setting = 50.0  # beta
    switching_gain: Setting = 4e4  # K, rad/s^3

    BOX: ClassVar = {"switching_gain": Range(1e4, 2e5, log=True)}

    def init(self, nominal: Plant, measured: Measurement) -> TerminalSlidingState:
        none = jnp.zeros_like(measured.motor_speed)
        return TerminalSlidingState(measured.motor_speed, none, none, none, measured.slip)

    def update(
        self,
        state: TerminalSlidingState,
        nominal: Plant,
        measured: Measurement,
        torque: PerAxle,
        step: float,
    ) -> TerminalSlidingState:
        error = measured.motor_speed - state.speed
        rate = (error - state.error) * (1 / step)
        # A cube root by way of the logarithm: a general power takes twice as long.
        root = jnp.sign(rate) * jnp.exp(jnp.log(jnp.abs(rate)) * (1 / 3))
        surface = self.surface_gain * error + rate * root**2 / self.rate_gain
        pushing = 0.6 * self.surface_gain * self.rate_gain * root
        pushing = pushing + self.switching_gain * jnp.sign(surface)
        push = state.push + step * pushing
        speed = state.speed + step * (torque * (1 / nominal.inertia) + push)
        return TerminalSlidingState(speed, push, error, -nominal.inertia * push, measured.slip)

    def largest_step(self, nominal: Plant) -> float:
        return 2e-4  # measured: at twice this step the sliding mode is lost
