"""Axles of a locomotive that twist between their wheels, with play where one is given."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.traction.plants.base import Held, lagging, parameter
from adhesion_jax.traction.plants.rigid_axles import RigidAxles
from adhesion_jax.traction.signals import Number, PerAxle


class TwistState(NamedTuple):
    """Speeds in rad/s and m/s, twist in rad and its rate in rad/s at the wheel, torque in N m."""

    motor_speed: PerAxle
    twist: PerAxle  # of the near wheel, on the side of the gear, against the far one
    twist_rate: PerAxle
    train_speed: Number
    torque: PerAxle


class TwistingAxles(RigidAxles):
    """Rigid axles but for a shaft between their wheels, as control does not know.

    (1 - s) Jw dw_n = T_w - T_x - r F_n, s Jw dw_f = T_x - r F_f, dphi = w_n - w_f,
    T_x = K z(phi) + D dphi, each force mu Q/2 at the slip of its wheel, the near one on the
    right rail. s is the share of the wheelset beyond the shaft. z(phi) is phi less half the play,
    towards zero, and zero within it: T_x is continuous, and its damping acts within the play, too.
    K = (2 pi f)^2 J and D = 4 pi f zeta J belong to the free mode of the shaft without play,
    1/J = 1/(s Jw) + 1/((1 - s) Jw + i^2 Jm), the gear taken without loss.
    For f to infinity these are rigid axles, to the order of 1/K.
    """

    far_inertia_share: Number = parameter("1", 0.01, 0.99, "of the wheelset, beyond its shaft")
    twist_frequency: Number = parameter("Hz", 1.0, 1000.0, "of the wheelset against the drive")
    twist_damping: Number = parameter("1", 0.0, 2.0, "of that mode, over the critical damping")
    backlash: Number = parameter("rad", 0.0, 0.1, "play of the drive, at the wheel")

    def init(self, motor_speed: PerAxle, train_speed: Number) -> TwistState:
        nothing = jnp.zeros_like(motor_speed)
        return TwistState(motor_speed, nothing + self.backlash / 2, nothing, train_speed, nothing)

    def derivative(self, state: TwistState, held: Held) -> TwistState:
        near, far = self._forces(state, held)
        shaft = self.shaft_torque(state)
        load, inertia = self.wheel_radius * near + shaft, self.wheelset_inertia - self._far_inertia
        angular = self.turned(state.torque, state.motor_speed, load, inertia)
        far_angular = (shaft - self.wheel_radius * far) / self._far_inertia
        return TwistState(
            angular,
            state.twist_rate,
            angular / self.gear_ratio - far_angular,
            self.forward(jnp.sum(near + far), state.train_speed, held.slope),
            lagging(self, state.torque, held.command),
        )

    def slip_velocity(self, state: TwistState) -> Float[Array, "sides axles"]:
        return jnp.stack(self._slips(state))

    def force(self, state: TwistState, held: Held) -> Float[Array, "sides axles"]:
        return jnp.stack(self._forces(state, held))

    def adhesion(self, state: TwistState, held: Held) -> PerAxle:
        near, far = held.surface.of_sides(*self._slips(state), state.train_speed)
        return (near + far) / 2

    def shaft_torque(self, state: TwistState) -> PerAxle:
        return self._stiffness * self._sprung(state) + self._damping * state.twist_rate

    def static_shaft_torque(self, slip: PerAxle, train_speed: Number, held: Held) -> PerAxle:
        near, far = held.surface.of_sides(slip, slip, train_speed)
        return self.wheel_radius * self.pressed(far, (near + far) / 2) / 2

    @property
    def _far_inertia(self) -> Number:
        return self.far_inertia_share * self.wheelset_inertia

    @property
    def _swinging(self) -> Number:
        """J in kg m^2."""
        rest = self.wheelset_inertia - self._far_inertia + self.gear_ratio**2 * self.motor_inertia
        return self._far_inertia * rest / (self._far_inertia + rest)

    @property
    def _stiffness(self) -> Number:
        """K in N m/rad."""
        return (2 * jnp.pi * self.twist_frequency) ** 2 * self._swinging

    @property
    def _damping(self) -> Number:
        """D in N m s/rad."""
        return 4 * jnp.pi * self.twist_frequency * self.twist_damping * self._swinging

    def _sprung(self, state: TwistState) -> PerAxle:
        """Twist that the shaft feels beyond its play, z in rad."""
        within = self.backlash / 2
        beyond = state.twist - jnp.sign(state.twist) * within
        return jnp.where(jnp.abs(state.twist) >= within, beyond, 0.0)

    def _slips(self, state: TwistState) -> tuple[PerAxle, PerAxle]:
        """Slip velocity of the near and of the far wheel, m/s."""
        near = self.circumferential(state.motor_speed) - state.train_speed
        return near, near - self.wheel_radius * state.twist_rate

    def _forces(self, state: TwistState, held: Held) -> tuple[PerAxle, PerAxle]:
        """Force at the rail of the near and of the far wheel, N."""
        near, far = held.surface.of_sides(*self._slips(state), state.train_speed)
        mean = (near + far) / 2
        return self.pressed(near, mean) / 2, self.pressed(far, mean) / 2
