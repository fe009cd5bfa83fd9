"""Axles that do not twist, each with a motor and a gear: the plants of Fang et al. and of HXD1F."""

from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.traction.plants.base import (
    GRAVITY,
    Held,
    Plant,
    against_motion,
    lagging,
    parameter,
)
from adhesion_jax.traction.signals import Number, PerAxle


class RigidState(NamedTuple):
    """Speeds in rad/s and m/s, torque in N m."""

    motor_speed: PerAxle
    train_speed: Number
    torque: PerAxle


class RigidAxles(Plant):
    """Jm dw = T - T_g, Jw dw/i = T_w - r F, M dV = n sum F - R(V) - M g sin(slope).

    w is the speed of the motor, i the gear ratio, v_s = r w/i - V, F = mu(v_s) W g. The gear hands
    on T_w = i eta T_g where the motor drives the wheel and T_w = i T_g/eta where the wheel drives
    the motor, so that its loss is never negative: which of them, the sign of (Jw T/(i Jm) + r F) w
    tells without eta. R = M (a + b V + c V^2) with V in km/h. Each axle stands for n alike.
    An axle bears Q_j = W_j g - t_j F, F the force of all axles of its unit (a locomotive): what
    the leading axles lose by the moment of the tractive force, the last gain.

    After Fang et al. 2018, Energies 11, Eq. 1 to 3, which have the loss in the load alone, and
    "Optimal Utilization of Adhesion Force ...", J. Adv. Transport. 2019, 6270515.
    """

    wheel_radius: PerAxle = parameter("m", 0.1, 2.0, "radius of the wheels of each axle")
    axle_load: PerAxle = parameter("kg", 1.0, 1e5, "mass that each axle bears")
    gear_ratio: Number = parameter("1", 0.1, 100.0, "motor speed over wheel speed")
    gear_efficiency: Number = parameter("1", 0.1, 1.0, "of the gear")
    motor_inertia: Number = parameter("kg m^2", 1e-3, 1e5, "of motor and pinion")
    wheelset_inertia: Number = parameter("kg m^2", 1e-3, 1e5, "of wheels, axle and gear wheel")
    train_mass: Number = parameter("kg", 1.0, 1e9, "of the train, or of its share of these axles")
    axles_alike: Number = parameter("1", 1.0, 1000.0, "axles that each axle stands for")
    load_transfer: PerAxle = parameter("1", -1.0, 1.0, "load an axle loses per force of its unit")
    axles_in_unit: Number = parameter("1", 1.0, 1000.0, "axles that share a frame, in their order")
    resistance_a: Number = parameter("N/kg", 0.0, 1.0, "running resistance at rest")
    resistance_b: Number = parameter("N/kg/(km/h)", 0.0, 1.0, "its growth with speed")
    resistance_c: Number = parameter("N/kg/(km/h)^2", 0.0, 1.0, "its growth with the squared speed")

    def init(self, motor_speed: PerAxle, train_speed: Number) -> Any:
        return RigidState(motor_speed, train_speed, jnp.zeros_like(motor_speed))

    def derivative(self, state: Any, held: Held) -> Any:
        force = self.force(state, held)
        return RigidState(
            self.turned(
                state.torque, state.motor_speed, self.wheel_radius * force, self.wheelset_inertia
            ),
            self.forward(jnp.sum(force), state.train_speed, held.slope),
            lagging(self, state.torque, held.command),
        )

    def motor_speed(self, state: Any) -> PerAxle:
        return state.motor_speed

    def slip_velocity(self, state: Any) -> Float[Array, "*contacts"]:
        return self.wheel_radius / self.gear_ratio * state.motor_speed - state.train_speed

    def force(self, state: Any, held: Held) -> Float[Array, "*contacts"]:
        adhesion = held.surface(self.slip_velocity(state), state.train_speed)
        return self.pressed(adhesion, adhesion)

    @property
    def inertia(self) -> PerAxle:
        wheelset = self.wheelset_inertia / (self.gear_ratio**2 * self.gear_efficiency)
        return jnp.broadcast_to(self.motor_inertia + wheelset, self.axle_load.shape)

    @property
    def radius(self) -> PerAxle:
        return self.wheel_radius

    def adhesion_of(self, load: PerAxle) -> PerAxle:
        return load / self._load_per_adhesion(load)

    def load_of(self, adhesion: PerAxle) -> PerAxle:
        return adhesion * self._load_per_adhesion(adhesion)

    def pull(self, adhesion: PerAxle) -> Number:
        return self.axles_alike * jnp.sum(self.pressed(adhesion, adhesion))

    def acceleration(self, adhesion: PerAxle, train_speed: Number) -> Number:
        return (self.pull(adhesion) - self._resistance(train_speed)) / self.train_mass

    def _load_per_adhesion(self, sign: PerAxle) -> PerAxle:
        """T_L = r F/(i eta) in traction, r F eta/i in braking."""
        efficiency = jnp.where(sign >= 0, self.gear_efficiency, 1 / self.gear_efficiency)
        return self.wheel_radius * self.axle_load * GRAVITY / (self.gear_ratio * efficiency)

    def pressed(self, adhesion: PerAxle, mean: PerAxle) -> PerAxle:
        """Force mu Q in N, with the Q of axles whose wheels have this mean of mu."""
        at_rest = adhesion * self.axle_load * GRAVITY
        if len(self.axle_load) == 1:
            return at_rest / (1 + mean * self.load_transfer)
        unit = jnp.arange(len(self.axle_load)) // self.axles_in_unit
        together = unit[:, None] == unit
        of_unit = jnp.sum(together * mean * self.axle_load * GRAVITY, axis=1)
        of_unit = of_unit / (1 + jnp.sum(together * mean * self.load_transfer, axis=1))
        return at_rest - adhesion * self.load_transfer * of_unit

    def turned(
        self, torque: PerAxle, motor_speed: PerAxle, load: PerAxle, inertia: Number
    ) -> PerAxle:
        """The acceleration in rad/s^2 of motors that turn this inertia against a load behind it."""
        inertia = inertia / self.gear_ratio
        handed = (inertia / self.motor_inertia * torque + load) * motor_speed
        # Divisions are of parameters alone: those of arrays [runs, axles] would cost as much as
        # the exponentials.
        driving = 1 / (self.gear_ratio * self.gear_efficiency)
        driven = self.gear_efficiency / self.gear_ratio
        through = jnp.where(handed >= 0, driving, driven)
        turned = jnp.where(
            handed >= 0,
            1 / (self.motor_inertia + inertia * driving),
            1 / (self.motor_inertia + inertia * driven),
        )
        return (torque - load * through) * turned

    def forward(self, force: Number, train_speed: Number, slope: Number) -> Number:
        """Acceleration in m/s^2 of the train under the force in N of all axles that are given."""
        against = self._resistance(train_speed) + self.train_mass * GRAVITY * jnp.sin(slope)
        return (self.axles_alike * force - against) * (1 / self.train_mass)

    def _resistance(self, train_speed: Number) -> Number:
        speed = 3.6 * jnp.abs(train_speed)
        each = self.resistance_a + speed * (self.resistance_b + speed * self.resistance_c)
        return against_motion(self.train_mass * each, train_speed)
