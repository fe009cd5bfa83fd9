"""Axles that twist between their wheels: the plant of Uyulan, Gokasan and Bogosyan 2018."""

from typing import NamedTuple

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


class ElasticState(NamedTuple):
    """Speeds in rad/s and m/s, twist in rad, torque in N m."""

    right: PerAxle  # the wheel on the side of the gear
    left: PerAxle
    twist: PerAxle
    train_speed: Number
    torque: PerAxle


class ElasticAxles(Plant):
    """J1 dw_R = i eta T - T_x - r_R F_R, J2 dw_L = T_x - r_L F_L, T_x = K phi + B (w_R - w_L).

    phi is the twist, dphi = w_R - w_L; J1 = i^2 Jm + Jg + Jw + Jx + Jb of motor, gear, right wheel,
    axle and brake, J2 = Jw; eta is 1/eta where the wheel drives the motor.
    m_dyn dV = n sum (F_R + F_L) - R(V) - m_stc g sin(slope), each force mu(v_s) m_a g, mu of its
    rail. R(V) after Davis, in N with m in t, A in m^2 and V in km/h:
    9.81 (.65 m + 13.2 axles + .00931 m V + .00453 A V^2), and of a curve, after Roeckl,
    650/(radius - 55) N/kN above a radius of 350 m, 500/(radius - 30) below.

    Source: Uyulan et al. 2018, J. Mod. Transport., 10.1007/s40534-018-0158-x, Eq. 1 to 20.
    """

    radius_right: PerAxle = parameter("m", 0.1, 2.0, "radius of the right wheel, beside the gear")
    radius_left: PerAxle = parameter("m", 0.1, 2.0, "radius of the left wheel")
    wheel_load: PerAxle = parameter("kg", 1.0, 1e5, "mass that each wheel bears")
    gear_ratio: Number = parameter("1", 0.1, 100.0, "motor speed over wheel speed")
    gear_efficiency: Number = parameter("1", 0.1, 1.0, "of the gear, in the torque of the wheel")
    motor_inertia: Number = parameter("kg m^2", 1e-3, 1e5, "of the motor")
    gear_inertia: Number = parameter("kg m^2", 0.0, 1e5, "of the gear, at the wheel")
    wheel_inertia: Number = parameter("kg m^2", 1e-3, 1e5, "of one wheel")
    axle_inertia: Number = parameter("kg m^2", 0.0, 1e5, "of the axle")
    brake_inertia: Number = parameter("kg m^2", 0.0, 1e5, "of the brake")
    shaft_stiffness: Number = parameter("N m/rad", 1.0, 1e12, "of the axle between its wheels")
    shaft_damping: Number = parameter("N m s/rad", 0.0, 1e9, "of the axle between its wheels")
    static_mass: Number = parameter("kg", 1.0, 1e9, "of the train")
    dynamic_mass: Number = parameter("kg", 1.0, 1e9, "of the train with what turns in it")
    axles_alike: Number = parameter("1", 1.0, 1000.0, "driven axles that each axle stands for")
    axles: Number = parameter("1", 1.0, 1000.0, "of the train, driven or not")
    frontal_area: Number = parameter("m^2", 0.1, 100.0, "of the train")
    curve_radius: Number = parameter("m", 60.0, 1e9, "of the track")

    def init(self, motor_speed: PerAxle, train_speed: Number) -> ElasticState:
        wheel, nothing = motor_speed / self.gear_ratio, jnp.zeros_like(motor_speed)
        return ElasticState(wheel, wheel, nothing, train_speed, nothing)

    def derivative(self, state: ElasticState, held: Held) -> ElasticState:
        # The wheels are kept apart: the compiler fills an array of both number by number, which
        # took a third of the time of a step.
        right, left = self._forces(state, held)
        driven = self.gear_ratio * self._efficiency(state) * state.torque
        shaft = self.shaft_torque(state)
        pull = self.axles_alike * jnp.sum(right + left)
        downhill = self.static_mass * GRAVITY * jnp.sin(held.slope)
        return ElasticState(
            (driven - shaft - self.radius_right * right) / self._beside_gear,
            (shaft - self.radius_left * left) / self.wheel_inertia,
            state.right - state.left,
            (pull - self._resistance(state.train_speed) - downhill) / self.dynamic_mass,
            lagging(self, state.torque, held.command),
        )

    def motor_speed(self, state: ElasticState) -> PerAxle:
        return self.gear_ratio * state.right

    def slip_velocity(self, state: ElasticState) -> Float[Array, "sides axles"]:
        return jnp.stack(self._slips(state))

    def force(self, state: ElasticState, held: Held) -> Float[Array, "sides axles"]:
        return jnp.stack(self._forces(state, held))

    def adhesion(self, state: ElasticState, held: Held) -> PerAxle:
        right, left = held.surface.of_sides(*self._slips(state), state.train_speed)
        return (right + left) / 2

    def shaft_torque(self, state: ElasticState) -> PerAxle:
        elastic = self.shaft_stiffness * state.twist
        return elastic + self.shaft_damping * (state.right - state.left)

    def static_shaft_torque(self, slip: PerAxle, train_speed: Number, held: Held) -> PerAxle:
        _, left = held.surface.of_sides(slip, slip, train_speed)
        return self.radius_left * left * self.wheel_load * GRAVITY

    @property
    def inertia(self) -> PerAxle:
        wheelset = self._beside_gear + self.wheel_inertia
        return jnp.broadcast_to(wheelset / self.gear_ratio**2, self.wheel_load.shape)

    @property
    def radius(self) -> PerAxle:
        return self.radius_right

    def adhesion_of(self, load: PerAxle) -> PerAxle:
        return load / self._load_per_adhesion

    def load_of(self, adhesion: PerAxle) -> PerAxle:
        return adhesion * self._load_per_adhesion

    def pull(self, adhesion: PerAxle) -> Number:
        return 2 * self.axles_alike * jnp.sum(adhesion * self.wheel_load * GRAVITY)

    def acceleration(self, adhesion: PerAxle, train_speed: Number) -> Number:
        return (self.pull(adhesion) - self._resistance(train_speed)) / self.dynamic_mass

    @property
    def _load_per_adhesion(self) -> PerAxle:
        both = (self.radius_right + self.radius_left) * self.wheel_load * GRAVITY
        return both / (self.gear_ratio * self.gear_efficiency)

    @property
    def _beside_gear(self) -> Number:
        own = self.gear_inertia + self.wheel_inertia + self.axle_inertia + self.brake_inertia
        return self.gear_ratio**2 * self.motor_inertia + own

    def _slips(self, state: ElasticState) -> tuple[PerAxle, PerAxle]:
        """Slip velocity of the right and of the left wheel, m/s."""
        right = self.radius_right * state.right - state.train_speed
        return right, self.radius_left * state.left - state.train_speed

    def _forces(self, state: ElasticState, held: Held) -> tuple[PerAxle, PerAxle]:
        """Force at the rail of the right and of the left wheel, N."""
        right, left = held.surface.of_sides(*self._slips(state), state.train_speed)
        return right * self.wheel_load * GRAVITY, left * self.wheel_load * GRAVITY

    def _efficiency(self, state: ElasticState) -> PerAxle:
        """Efficiency of the gear, or its inverse where the wheel drives the motor."""
        drives = state.torque * state.right >= 0
        return jnp.where(drives, self.gear_efficiency, 1 / self.gear_efficiency)

    def _resistance(self, train_speed: Number) -> Number:
        speed, tonnes = 3.6 * jnp.abs(train_speed), self.static_mass / 1000
        davis = 0.65 * tonnes + 13.2 * self.axles + 0.00931 * tonnes * speed
        davis = davis + 0.00453 * self.frontal_area * speed**2
        narrow = self.curve_radius < 350.0
        offset = jnp.where(narrow, 30.0, 55.0)
        curve = jnp.where(narrow, 500.0, 650.0) / (self.curve_radius - offset) / 1000
        return against_motion(GRAVITY * (davis + self.static_mass * curve), train_speed)
