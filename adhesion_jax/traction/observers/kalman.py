"""An extended Kalman filter of motor speed, train speed and load."""

from typing import ClassVar, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.traction.box import Range
from adhesion_jax.traction.observers.base import Observer
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.signals import Measurement, PerAxle, Setting


class KalmanState(NamedTuple):
    """Each axle has a filter of its own, which takes the loads of the others as they are."""

    motor_speed: PerAxle  # rad/s
    train_speed: PerAxle  # m/s
    load: PerAxle  # N m
    covariance: Float[Array, "3 3 axles"]  # of motor speed, train speed, load
    slip: PerAxle  # m/s, through the filter of the load
    ahead: PerAxle  # integral of what that has passed less what it was given


class Kalman(Observer):
    """dw = (T - T_L)/J, dV = a(mu(T_L), V), dT_L = white noise of the intensity q^2.

    `motor_noise` (rad/s) and `train_noise` (m/s) are the standard deviations of the sensors and
    `period` the time in s between their samples: a sample that is held for many steps counts once,
    as noise of the intensity R period. `load_walk` is q in N m/s^(1/2), the one that is tuned.

    The slip is given the lag of the load by the gains of the filter: a speed whose derivative is
    minus the slip would be observed as that load by a motor with J = 1.
    """

    motor_noise: Setting = 0.02
    train_noise: Setting = 5e-3
    load_walk: Setting = 5e3
    period: Setting = 1e-3

    BOX: ClassVar = {"load_walk": Range(1e3, 1e5, log=True)}

    def init(self, nominal: Plant, measured: Measurement) -> KalmanState:
        speed = measured.motor_speed
        none = jnp.zeros_like(speed)
        spread = jnp.stack(
            [
                none + self.motor_noise**2,
                none + self.train_noise**2,
                nominal.load_of(jnp.full_like(speed, 0.1)) ** 2,
            ]
        )
        covariance = spread[:, None, :] * jnp.eye(3)[:, :, None]
        train = jnp.broadcast_to(measured.train_speed, speed.shape)
        return KalmanState(speed, train, none, covariance, measured.slip, none)

    def update(
        self,
        state: KalmanState,
        nominal: Plant,
        measured: Measurement,
        torque: PerAxle,
        step: float,
    ) -> KalmanState:
        held = self.period / step
        motor_gain, covariance = _gain(state.covariance, 0, self.motor_noise**2 * held)
        train_gain, covariance = _gain(covariance, 1, self.train_noise**2 * held)

        error = measured.motor_speed - state.motor_speed
        speed, train, load = (
            one + gain * error for one, gain in zip(state[:3], motor_gain, strict=True)
        )
        error = measured.train_speed - train
        speed, train, load = (
            one + gain * error for one, gain in zip((speed, train, load), train_gain, strict=True)
        )

        def accelerating(load: PerAxle, train: Float[Array, ""]) -> Float[Array, ""]:
            return nominal.acceleration(nominal.adhesion_of(load), train)

        with_slopes = jax.value_and_grad(accelerating, (0, 1))
        acceleration, (by_load, by_train) = with_slopes(load, jnp.mean(train))
        none = jnp.zeros_like(load)
        one = jnp.ones_like(load)
        moved = jnp.stack(
            [
                jnp.stack([one, none, -step / nominal.inertia]),
                jnp.stack([none, one + step * by_train, step * by_load]),
                jnp.stack([none, none, one]),
            ]
        )
        covariance = _product(_product(moved, covariance), moved.transpose(1, 0, 2))
        covariance = covariance.at[2, 2].add(step * self.load_walk**2)

        # The same gains for the slip: e is the speed observed less the integral that it follows.
        inertia = nominal.inertia
        ahead = state.ahead * (1 - motor_gain[0])
        passed = state.slip - motor_gain[2] / inertia * state.ahead
        return KalmanState(
            speed + step * (torque - load) / inertia,
            train + step * acceleration,
            load,
            covariance,
            passed,
            ahead + step * (measured.slip - passed),
        )


def _gain(
    covariance: Float[Array, "3 3 axles"], which: int, variance: Setting
) -> tuple[Float[Array, "3 axles"], Float[Array, "3 3 axles"]]:
    """The gain of a measurement of one state, and the covariance after it."""
    gain = covariance[:, which] / (covariance[which, which] + variance)
    return gain, covariance - gain[:, None] * covariance[which][None]


def _product(a: Float[Array, "3 3 axles"], b: Float[Array, "3 3 axles"]) -> Array:
    return jnp.sum(a[:, :, None] * b[None], axis=1)
