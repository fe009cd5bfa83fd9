"""Axles that twist between their wheels: the plant of Uyulan, Gokasan and Bogosyan 2018."""

from collections.abc import Mapping
from typing import ClassVar, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.traction.plants.base import (
    DRIVE,
    GRAVITY,
    Held,
    Plant,
    Powers,
    Quantity,
    against_motion,
    lagging,
)


class ElasticState(NamedTuple):
    """Speeds in rad/s and m/s, twist in rad, torque in N m."""

    right: Float[Array, " axles"]  # the wheel on the side of the gear
    left: Float[Array, " axles"]
    twist: Float[Array, " axles"]
    train_speed: Float[Array, ""]
    torque: Float[Array, " axles"]


class ElasticAxles(Plant):
    """J1 dw_R = i eta T - T_x - r_R F_R, J2 dw_L = T_x - r_L F_L, T_x = K phi + B (w_R - w_L).

    phi is the twist, dphi = w_R - w_L; J1 = i^2 Jm + Jg + Jw + Jx + Jb of motor, gear, right wheel,
    axle and brake, J2 = Jw; eta is 1/eta where the wheel drives the motor.
    m_dyn dV = n sum (F_R + F_L) - R(V) - m_stc g sin(slope), each force mu(v_s) m_a g. R(V) after
    Davis, in N with m in t, A in m^2 and V in km/h:
    9.81 (.65 m + 13.2 axles + .00931 m V + .00453 A V^2), and of a curve, after Roeckl,
    650/(radius - 55) N/kN above a radius of 350 m, 500/(radius - 30) below.

    Source: Uyulan et al. 2018, J. Mod. Transport., 10.1007/s40534-018-0158-x, Eq. 1 to 20.
    """

    radius_right: Float[Array, " axles"]
    radius_left: Float[Array, " axles"]
    wheel_load: Float[Array, " axles"]
    gear_ratio: Float[Array, ""]
    gear_efficiency: Float[Array, ""]
    motor_inertia: Float[Array, ""]
    gear_inertia: Float[Array, ""]
    wheel_inertia: Float[Array, ""]
    axle_inertia: Float[Array, ""]
    brake_inertia: Float[Array, ""]
    shaft_stiffness: Float[Array, ""]
    shaft_damping: Float[Array, ""]
    static_mass: Float[Array, ""]
    dynamic_mass: Float[Array, ""]
    axles_alike: Float[Array, ""]
    axles: Float[Array, ""]
    frontal_area: Float[Array, ""]
    curve_radius: Float[Array, ""]
    torque_limit: Float[Array, ""]
    power_limit: Float[Array, ""]
    torque_lag: Float[Array, ""]
    dead_time: Float[Array, ""]

    PER_AXLE: ClassVar[tuple[str, ...]] = ("radius_right", "radius_left", "wheel_load")
    PARAMETERS: ClassVar[Mapping[str, Quantity]] = {
        "radius_right": Quantity("m", 0.1, 2.0, "radius of the right wheel, beside the gear"),
        "radius_left": Quantity("m", 0.1, 2.0, "radius of the left wheel"),
        "wheel_load": Quantity("kg", 1.0, 1e5, "mass that each wheel bears"),
        "gear_ratio": Quantity("1", 0.1, 100.0, "motor speed over wheel speed"),
        "gear_efficiency": Quantity("1", 0.1, 1.0, "of the gear, in the torque of the wheel"),
        "motor_inertia": Quantity("kg m^2", 1e-3, 1e5, "of the motor"),
        "gear_inertia": Quantity("kg m^2", 0.0, 1e5, "of the gear, at the wheel"),
        "wheel_inertia": Quantity("kg m^2", 1e-3, 1e5, "of one wheel"),
        "axle_inertia": Quantity("kg m^2", 0.0, 1e5, "of the axle"),
        "brake_inertia": Quantity("kg m^2", 0.0, 1e5, "of the brake"),
        "shaft_stiffness": Quantity("N m/rad", 1.0, 1e12, "of the axle between its wheels"),
        "shaft_damping": Quantity("N m s/rad", 0.0, 1e9, "of the axle between its wheels"),
        "static_mass": Quantity("kg", 1.0, 1e9, "of the train"),
        "dynamic_mass": Quantity("kg", 1.0, 1e9, "of the train with what turns in it"),
        "axles_alike": Quantity("1", 1.0, 1000.0, "driven axles that each axle stands for"),
        "axles": Quantity("1", 1.0, 1000.0, "of the train, driven or not"),
        "frontal_area": Quantity("m^2", 0.1, 100.0, "of the train"),
        "curve_radius": Quantity("m", 60.0, 1e9, "of the track"),
        **DRIVE,
    }

    def init(
        self, motor_speed: Float[Array, " axles"], train_speed: Float[Array, ""]
    ) -> ElasticState:
        wheel, nothing = motor_speed / self.gear_ratio, jnp.zeros_like(motor_speed)
        return ElasticState(wheel, wheel, nothing, train_speed, nothing)

    def derivative(self, state: ElasticState, held: Held) -> ElasticState:
        # The wheels are kept apart: the compiler fills an array of both number by number, which
        # took a third of the time of a step.
        right, left = (self._force(slip, state, held) for slip in self._slips(state))
        driven = self.gear_ratio * self._efficiency(state) * state.torque
        shaft = self.shaft_stiffness * state.twist
        shaft = shaft + self.shaft_damping * (state.right - state.left)
        pull = self.axles_alike * jnp.sum(right + left)
        downhill = self.static_mass * GRAVITY * jnp.sin(held.slope)
        return ElasticState(
            (driven - shaft - self.radius_right * right) / self._beside_gear,
            (shaft - self.radius_left * left) / self.wheel_inertia,
            state.right - state.left,
            (pull - self._resistance(state.train_speed) - downhill) / self.dynamic_mass,
            lagging(self, state.torque, held.command),
        )

    def motor_speed(self, state: ElasticState) -> Float[Array, " axles"]:
        return self.gear_ratio * state.right

    def slip_velocity(self, state: ElasticState) -> Float[Array, "sides axles"]:
        return jnp.stack(self._slips(state))

    def force(self, state: ElasticState, held: Held) -> Float[Array, "sides axles"]:
        return self._force(self.slip_velocity(state), state, held)

    def energy(self, state: ElasticState) -> Float[Array, ""]:
        turning = self._beside_gear * state.right**2 + self.wheel_inertia * state.left**2
        twisted = self.shaft_stiffness * state.twist**2
        moving = 0.5 * self.dynamic_mass * state.train_speed**2
        return 0.5 * self.axles_alike * jnp.sum(turning + twisted) + moving

    def powers(self, state: ElasticState, held: Held) -> Powers:
        forces = self.force(state, held)
        motor = state.torque * self.motor_speed(state)
        damped = self.shaft_damping * jnp.sum((state.right - state.left) ** 2)
        return Powers(
            motor=self.axles_alike * jnp.sum(motor),
            slip=self.axles_alike * jnp.sum(forces * self.slip_velocity(state)),
            gear=self.axles_alike * jnp.sum((1 - self._efficiency(state)) * motor),
            shaft=self.axles_alike * damped,
            resistance=self._resistance(state.train_speed) * state.train_speed,
            slope=self.static_mass * GRAVITY * jnp.sin(held.slope) * state.train_speed,
        )

    @property
    def inertia(self) -> Float[Array, " axles"]:
        wheelset = self._beside_gear + self.wheel_inertia
        return jnp.broadcast_to(wheelset / self.gear_ratio**2, self.wheel_load.shape)

    @property
    def radius(self) -> Float[Array, " axles"]:
        return self.radius_right

    def adhesion_of(self, load: Float[Array, " axles"]) -> Float[Array, " axles"]:
        return load / self._load_per_adhesion

    def load_of(self, adhesion: Float[Array, " axles"]) -> Float[Array, " axles"]:
        return adhesion * self._load_per_adhesion

    def acceleration(
        self, adhesion: Float[Array, " axles"], train_speed: Float[Array, ""]
    ) -> Float[Array, ""]:
        pull = 2 * self.axles_alike * jnp.sum(adhesion * self.wheel_load * GRAVITY)
        return (pull - self._resistance(train_speed)) / self.dynamic_mass

    @property
    def _load_per_adhesion(self) -> Float[Array, " axles"]:
        both = (self.radius_right + self.radius_left) * self.wheel_load * GRAVITY
        return both / (self.gear_ratio * self.gear_efficiency)

    @property
    def _beside_gear(self) -> Float[Array, ""]:
        own = self.gear_inertia + self.wheel_inertia + self.axle_inertia + self.brake_inertia
        return self.gear_ratio**2 * self.motor_inertia + own

    def _slips(self, state: ElasticState) -> tuple[Float[Array, " axles"], Float[Array, " axles"]]:
        """Slip velocity of the right and of the left wheel, m/s."""
        right = self.radius_right * state.right - state.train_speed
        return right, self.radius_left * state.left - state.train_speed

    def _force(
        self, slip: Float[Array, "*sides axles"], state: ElasticState, held: Held
    ) -> Float[Array, "*sides axles"]:
        """Force at the rail in N of wheels at these slip velocities."""
        return held.surface(slip, state.train_speed) * self.wheel_load * GRAVITY

    def _efficiency(self, state: ElasticState) -> Float[Array, " axles"]:
        """Efficiency of the gear, or its inverse where the wheel drives the motor."""
        drives = state.torque * state.right >= 0
        return jnp.where(drives, self.gear_efficiency, 1 / self.gear_efficiency)

    def _resistance(self, train_speed: Float[Array, ""]) -> Float[Array, ""]:
        speed, tonnes = 3.6 * jnp.abs(train_speed), self.static_mass / 1000
        davis = 0.65 * tonnes + 13.2 * self.axles + 0.00931 * tonnes * speed
        davis = davis + 0.00453 * self.frontal_area * speed**2
        narrow = self.curve_radius < 350.0
        offset = jnp.where(narrow, 30.0, 55.0)
        curve = jnp.where(narrow, 500.0, 650.0) / (self.curve_radius - offset) / 1000
        return against_motion(GRAVITY * (davis + self.static_mass * curve), train_speed)
