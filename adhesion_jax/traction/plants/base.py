"""The contract of a plant: a train on its wheels, driven by the torque of its motors."""

import dataclasses
from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.traction.signals import Number, PerAxle
from adhesion_jax.traction.surface import RailSurface

GRAVITY = 9.81

#: Resistance opposes motion; below this speed in m/s it is proportional to it and vanishes at rest.
_AT_REST = 0.01


class Quantity(NamedTuple):
    """A parameter of a plant: unit, bounds, meaning, and whether it may differ by axle."""

    unit: str
    lower: float
    upper: float
    meaning: str
    per_axle: bool = False


class Held(NamedTuple):
    """The inputs of a plant that are constant during a step."""

    command: PerAxle  # torque of each motor in N m
    surface: RailSurface
    slope: Number  # of the track, as an angle in rad; positive uphill


def parameter(unit: str, lower: float, upper: float, meaning: str) -> Any:
    """The declaration of a parameter of a plant."""
    return eqx.field(metadata={"quantity": Quantity(unit, lower, upper, meaning)})


class Plant(eqx.Module):
    """The equations of motion of a train; its fields are its parameters, which `quantities` lists.

    Plants are given and give arrays [axles] for what each axle has. A state has the fields
    `train_speed` and `torque`. The model of the train in the control is a plant too: observers and
    controllers use its properties and the methods that take no state.
    """

    gear_ratio: eqx.AbstractVar[Number]
    axles_alike: eqx.AbstractVar[Number]
    torque_limit: Number = parameter("N m", 0.0, 1e6, "largest torque of a motor")
    power_limit: Number = parameter("W", 0.0, 1e8, "largest power of a motor")
    torque_lag: Number = parameter("s", 0.0, 10.0, "time constant of the torque; 0 for none")
    dead_time: Number = parameter("s", 0.0, 10.0, "from a command to its first effect")

    @abstractmethod
    def init(self, motor_speed: PerAxle, train_speed: Number) -> Any:
        """The state at these speeds, in rad/s and m/s, without torque or twist."""

    @abstractmethod
    def derivative(self, state: Any, held: Held) -> Any:
        """Time derivative of the state, per second."""

    @abstractmethod
    def motor_speed(self, state: Any) -> PerAxle:
        """Speed of each motor, rad/s."""

    @abstractmethod
    def slip_velocity(self, state: Any) -> Float[Array, "*contacts"]:
        """Slip velocity of each contact in m/s: circumferential speed less train speed."""

    @abstractmethod
    def force(self, state: Any, held: Held) -> Float[Array, "*contacts"]:
        """Force at the rail in N, for each contact of one axle of those that are alike."""

    @property
    @abstractmethod
    def inertia(self) -> PerAxle:
        """J in J dw = T - T_L at the motor of an axle in traction, kg m^2."""

    @property
    @abstractmethod
    def radius(self) -> PerAxle:
        """Radius in m of the wheel that the motor drives."""

    @abstractmethod
    def adhesion_of(self, load: PerAxle) -> PerAxle:
        """The adhesion at which the rail loads the motor with T_L, in N m; odd."""

    @abstractmethod
    def load_of(self, adhesion: PerAxle) -> PerAxle:
        """The inverse of `adhesion_of`."""

    @abstractmethod
    def pull(self, adhesion: PerAxle) -> Number:
        """Force of all axles at the rail in N, whose wheels have this adhesion in the mean."""

    @abstractmethod
    def acceleration(self, adhesion: PerAxle, train_speed: Number) -> Number:
        """Acceleration of the train on level track, m/s^2."""

    def shaft_torque(self, state: Any) -> PerAxle:
        """Torque in N m of the shaft between the wheels of each axle; NaN where none twists."""
        return jnp.full_like(state.torque, jnp.nan)

    def static_shaft_torque(self, slip: PerAxle, train_speed: Number, held: Held) -> PerAxle:
        """That at which both wheels of each axle keep this slip in m/s, N m."""
        return jnp.full_like(slip, jnp.nan)

    def circumferential(self, motor_speed: PerAxle) -> PerAxle:
        """Speed of the wheel at its rim in m/s."""
        return self.radius / self.gear_ratio * motor_speed

    def adhesion(self, state: Any, held: Held) -> PerAxle:
        """Mean over the wheels of each axle."""
        return held.surface(self.slip_velocity(state), state.train_speed)


def quantities(kind: type[Plant]) -> Mapping[str, Quantity]:
    """The parameters of a kind of plant, by name; those that every plant has stand last."""
    shared = {field.name for field in dataclasses.fields(Plant)}
    return {
        field.name: field.metadata["quantity"]._replace(per_axle=field.type is PerAxle)
        for field in sorted(dataclasses.fields(kind), key=lambda field: field.name in shared)
    }


def limited(
    plant: Plant, command: PerAxle, motor_speed: PerAxle, share: Number | float = 1.0
) -> PerAxle:
    """The command within the limits of torque and power: |T| <= min(T_max, share P_max/|w|)."""
    by_power = share * plant.power_limit / jnp.maximum(jnp.abs(motor_speed), 1e-9)
    most = jnp.minimum(plant.torque_limit, by_power)
    return jnp.clip(command, -most, most)


def lagging(plant: Plant, torque: PerAxle, command: PerAxle) -> Array:
    """dT/dt = (T_cmd - T)/lag; without a lag the torque is the command, which `held_by` sets."""
    lags = plant.torque_lag > 0
    return jnp.where(lags, 1 / jnp.where(lags, plant.torque_lag, 1.0), 0.0) * (command - torque)


def held_by(plant: Plant, torque: PerAxle, command: PerAxle) -> PerAxle:
    """The torque from which a command on begins to act."""
    return jnp.where(plant.torque_lag > 0, torque, command)


def against_motion(force: Number, train_speed: Number) -> Number:
    """A resistance with the sign of the speed, proportional to it near rest."""
    return force * jnp.clip(train_speed * (1 / _AT_REST), -1.0, 1.0)
