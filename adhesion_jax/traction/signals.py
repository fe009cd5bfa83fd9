"""The signals that pass between the parts of the loop."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

#: A number of the whole train, one for each axle, and a setting, which is either.
Number = Float[Array, ""]
PerAxle = Float[Array, " axles"]
Setting = float | Float[Array, "..."]


class Measurement(NamedTuple):
    """The measurements of the sensors of a train."""

    motor_speed: PerAxle  # rad/s
    train_speed: Number  # m/s
    slip: PerAxle  # from both and from the radius as it is known, m/s
    load: PerAxle | None  # the true one, for an observer that declares it is given


class Reference(NamedTuple):
    """The slip velocity that a seeker asks for, in m/s, and its rate of change in m/s^2."""

    slip: PerAxle
    rate: PerAxle


class Signals(NamedTuple):
    """The input of seekers and controllers at a control sample; it contains no true state."""

    time: Number  # s
    demand: PerAxle  # the driver's torque, N m
    motor_speed: PerAxle  # rad/s, measured
    train_speed: Number  # m/s, measured
    slip: PerAxle  # m/s, measured
    torque: PerAxle  # as the drive reports it, N m
    load: PerAxle  # of the motor, as observed, N m
    adhesion: PerAxle  # as observed
    slip_beside: PerAxle  # m/s, with the same lag as the adhesion observed
    optimum: PerAxle | None  # m/s, for a seeker that declares it is given
    reference: Reference | None = None  # for a controller that follows a slip

    @property
    def direction(self) -> PerAxle:
        """1 in traction, -1 in braking: laws are those of traction, in braking all signs turn."""
        return jnp.where(self.demand < 0, -1.0, 1.0)
