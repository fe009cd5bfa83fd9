"""A published control system: what runs on which plant, over which rails."""

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp

from adhesion_jax.curves import Exponential
from adhesion_jax.traction.controllers import Controller
from adhesion_jax.traction.driver import Driver
from adhesion_jax.traction.loop import Loop
from adhesion_jax.traction.observers import Observer
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.rails import Rails
from adhesion_jax.traction.seekers import Seeker
from adhesion_jax.traction.sensors import Noise, Sensors
from adhesion_jax.traction.surface import Surface


class Case(NamedTuple):
    """One scenario of a paper under one method."""

    scenario: str
    method: str
    segments: tuple[str, ...]  # names of the rails in their order
    rails: Rails
    observer: Observer
    seeker: Seeker | None
    controller: Controller
    sampled: float = 0.0  # s from a sample of the sensors to the next; 0: unsampled


class System(NamedTuple):
    """What all cases of a paper share."""

    title: str
    plant: str  # name of the parameters that ship
    step: float  # of the plant, s
    control_period: float  # s
    duration: float  # s
    train_speed: float  # at first, m/s
    slip: float  # at first, m/s
    slope: float  # of the track, rad
    driver: Driver
    noise: Noise
    cases: Sequence[Case]


def built(system: System, case: Case, plant: Plant, noisy: bool = False) -> Loop:
    """The loop of a case on a plant that control knows exactly."""
    return Loop(
        plant=plant,
        nominal=plant,
        rails=case.rails,
        driver=system.driver,
        sensors=Sensors(system.noise if noisy else None, period=case.sampled),
        observer=case.observer,
        seeker=case.seeker,
        controller=case.controller,
        train_speed=jnp.asarray(system.train_speed),
        slip=jnp.full(plant.radius.shape, system.slip),
        slope=jnp.asarray(system.slope),
    )


def exponential(a: float, b: float, c: float) -> Surface:
    """A surface mu = c (exp(-a v_s) - exp(-b v_s)), v_s in m/s."""
    return Surface(Exponential(a=a, b=b, c=c))
