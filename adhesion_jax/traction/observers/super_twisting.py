"""The second-order sliding mode observer of Uyulan et al. 2018: a super-twisting algorithm."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.traction.observers.base import Observer, Scalar
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.signals import Measured


class SuperTwistingState(NamedTuple):
    speed: Float[Array, " axles"]  # rad/s
    deceleration: Float[Array, " axles"]  # by the load, rad/s^2
    slip: Float[Array, " axles"]  # m/s
    load: Float[Array, " axles"]  # N m


class SuperTwisting(Observer):
    """dw^ = T/J - z + 1.5 sqrt(G) |e|^(1/2) sgn e, dz = -1.1 G sgn e, e = w - w^, T_L = J z.

    z is taken at the end of the step. G = i L, L the gain at the wheel in rad/s^3, which is to be
    above the largest |d^2 w_wheel/dt^2|. The paper names the observer without its equations; these
    are those of Levant 1998, Automatica 34.
    """

    gain: Scalar

    def init(self, nominal: Plant, measured: Measured) -> SuperTwistingState:
        none = jnp.zeros_like(measured.motor_speed)
        return SuperTwistingState(measured.motor_speed, none, measured.slip, none)

    def update(
        self,
        state: SuperTwistingState,
        nominal: Plant,
        measured: Measured,
        torque: Float[Array, " axles"],
        step: float,
    ) -> SuperTwistingState:
        gain = nominal.gear_ratio * self.gain
        error = measured.motor_speed - state.speed
        pulled = 1.5 * jnp.sqrt(gain * jnp.abs(error)) * jnp.sign(error)
        deceleration = state.deceleration - step * 1.1 * gain * jnp.sign(error)
        turning = torque / nominal.inertia - deceleration + pulled
        return SuperTwistingState(
            state.speed + step * turning,
            deceleration,
            measured.slip,
            nominal.inertia * deceleration,
        )

    def load(self, state: SuperTwistingState, nominal: Plant) -> Float[Array, " axles"]:
        return state.load

    def slip(self, state: SuperTwistingState) -> Float[Array, " axles"]:
        return state.slip

    def largest_step(self, nominal: Plant) -> float:
        return np.inf  # a sliding mode chatters with the step, and is bounded at any
