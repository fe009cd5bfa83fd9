"""The signals that pass between the parts of the loop."""

from typing import NamedTuple

from jaxtyping import Array, Float


class Measured(NamedTuple):
    """The measurements of the sensors of a train."""

    motor_speed: Float[Array, " axles"]  # rad/s
    train_speed: Float[Array, ""]  # m/s
    slip: Float[Array, " axles"]  # from both and from the radius as it is known, m/s
    load: Float[Array, " axles"] | None  # the true one, for an observer that declares it is given


class Signals(NamedTuple):
    """The input of seekers and controllers at a control sample; it contains no true state."""

    time: Float[Array, ""]  # s
    demand: Float[Array, " axles"]  # the driver's torque, N m
    motor_speed: Float[Array, " axles"]  # rad/s, measured
    train_speed: Float[Array, ""]  # m/s, measured
    slip: Float[Array, " axles"]  # m/s, measured
    torque: Float[Array, " axles"]  # as the drive reports it, N m
    load: Float[Array, " axles"]  # of the motor, as observed, N m
    adhesion: Float[Array, " axles"]  # as observed
    slip_beside: Float[Array, " axles"]  # m/s, with the same lag as the adhesion observed
    optimum: Float[Array, " axles"] | None  # m/s, for a seeker that declares it is given


class Reference(NamedTuple):
    """The slip velocity that a seeker asks for, in m/s, and its rate of change in m/s^2."""

    slip: Float[Array, " axles"]
    rate: Float[Array, " axles"]
