"""The second-order sliding mode observer of Uyulan et al. 2018: a super-twisting algorithm."""

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
    above the largest |d^2 w_wheel/dt^2|. The paper names the observer without its equations; these
    are those of Levant 1998, Automatica 34. It chatters with the step, and is bounded at any.
    """

    gain: Setting

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
