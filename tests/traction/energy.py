"""The energy of a train and where it goes, from its parameters and its derivative alone."""

from typing import Any, NamedTuple

import jax.numpy as jnp

from adhesion_jax.traction.plants.base import GRAVITY
from adhesion_jax.traction.plants.elastic_axles import ElasticAxles
from adhesion_jax.traction.plants.twisting_axles import TwistingAxles


class Powers(NamedTuple):
    """Powers of the whole train in W: what the motors put in, and where it goes."""

    motor: Any
    slip: Any
    gear: Any
    shaft: Any  # dissipated by the damping of an elastic axle
    resistance: Any
    slope: Any


def _twist(plant):
    """Stiffness in N m/rad and damping in N m s/rad of the shaft between the wheels."""
    if isinstance(plant, ElasticAxles):
        return plant.shaft_stiffness, plant.shaft_damping
    far = plant.far_inertia_share * plant.wheelset_inertia
    rest = plant.wheelset_inertia - far + plant.gear_ratio**2 * plant.motor_inertia
    swinging, angular = far * rest / (far + rest), 2 * jnp.pi * plant.twist_frequency
    return angular**2 * swinging, 2 * angular * plant.twist_damping * swinging


def _near_inertia(plant):
    """What turns with the wheels that a motor drives, without the motor, kg m^2."""
    if isinstance(plant, ElasticAxles):
        own = plant.gear_inertia + plant.axle_inertia + plant.brake_inertia
        return own + plant.wheel_inertia
    far = plant.far_inertia_share if isinstance(plant, TwistingAxles) else 0.0
    return (1 - far) * plant.wheelset_inertia


def energy(plant, state):
    """Kinetic and elastic energy of the whole train in J."""
    elastic = isinstance(plant, ElasticAxles)
    mass = plant.dynamic_mass if elastic else plant.train_mass
    near = plant.motor_speed(state) / plant.gear_ratio
    inertia = _near_inertia(plant) + plant.gear_ratio**2 * plant.motor_inertia
    whole = inertia * near**2
    if elastic:
        whole = whole + plant.wheel_inertia * state.left**2 + _twist(plant)[0] * state.twist**2
    elif isinstance(plant, TwistingAxles):
        beyond = jnp.maximum(jnp.abs(state.twist) - plant.backlash / 2, 0.0)
        far = plant.far_inertia_share * plant.wheelset_inertia
        whole = whole + far * (near - state.twist_rate) ** 2 + _twist(plant)[0] * beyond**2
    return 0.5 * (plant.axles_alike * jnp.sum(whole) + mass * state.train_speed**2)


def powers(plant, state, held):
    """Powers in W: the energy changes by that of the motors less all the others."""
    elastic = isinstance(plant, ElasticAxles)
    forces, rate = plant.force(state, held), plant.derivative(state, held)
    motor_speed, speed = plant.motor_speed(state), state.train_speed
    twists = forces.ndim > 1
    load = plant.radius * (forces[0] if twists else forces)
    rate_of_twist, damping = jnp.zeros_like(load), 0.0
    if twists:
        load = load + plant.shaft_torque(state)
        rate_of_twist = state.right - state.left if elastic else state.twist_rate
        damping = _twist(plant)[1]
    accelerating = plant.motor_speed(rate)
    near = _near_inertia(plant) * accelerating / plant.gear_ratio + load
    into = state.torque - plant.motor_inertia * accelerating - near / plant.gear_ratio
    at_rest = plant.acceleration(jnp.zeros_like(state.torque), speed)
    mass = plant.dynamic_mass if elastic else plant.train_mass
    weight = GRAVITY * (plant.static_mass if elastic else plant.train_mass)
    axles = plant.axles_alike
    return Powers(
        motor=axles * jnp.sum(state.torque * motor_speed),
        slip=axles * jnp.sum(forces * plant.slip_velocity(state)),
        gear=axles * jnp.sum(into * motor_speed),
        shaft=axles * jnp.sum(damping * rate_of_twist**2),
        resistance=-mass * at_rest * speed,
        slope=weight * jnp.sin(held.slope) * speed,
    )
