"""A published control system: its methods, its plant and its rails."""

import tomllib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.traction.controllers import CONTROLLERS, Controller
from adhesion_jax.traction.driver import Driver
from adhesion_jax.traction.entrants import Entrant
from adhesion_jax.traction.loop import Loop
from adhesion_jax.traction.observers import OBSERVERS, Observer
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.rails import Rails
from adhesion_jax.traction.seekers import SEEKERS, Seeker
from adhesion_jax.traction.sensors import Sensors, SpeedNoise
from adhesion_jax.traction.signals import PerAxle


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
    """The settings that all cases of a paper share."""

    title: str
    source: str
    plant: str  # name of the parameters that ship
    step: float  # of the plant, s
    control_period: float | None  # s; None: every step of the plant
    duration: float  # s
    train_speed: float  # at first, m/s
    slip: float  # at first, m/s
    slope: float  # of the track, rad
    driver: Driver
    noise: SpeedNoise  # of the runs with noise; assumed, because no paper gives it
    cases: Callable[[float], Sequence[Case]]  # on a grid of steps in s; the paper's own come first
    repairs: Sequence[str]  # sentences on equations that differ from the printed ones
    assumptions: Sequence[str]  # sentences on what the paper leaves open beside the plant


def papers(name: str) -> Mapping[str, Any]:
    """The title, source, repairs and assumptions of a system, from the file beside it."""
    return tomllib.loads(Path(__file__).with_name(f"{name}.toml").read_text(encoding="utf-8"))


#: The name for the absence of a seeker.
NO_SEEKER = "none"


def with_parts(
    cases: Sequence[Case], observer: str | None, seeker: str | None, controller: str | None
) -> Sequence[Case]:
    """The first case of each scenario with the parts that are named; all cases if none is.

    A controller that follows no slip replaces the seeker too.
    """
    if observer is seeker is controller is None:
        return cases
    named = {"observer": observer, "seeker": seeker, "controller": controller}
    method = ", ".join(f"{part} {name}" for part, name in named.items() if name is not None)
    found = []
    for case in {case.scenario: case for case in reversed(cases)}.values():
        parts = case._replace(method=method)
        if observer is not None:
            parts = parts._replace(observer=OBSERVERS[observer])
        if controller is not None:
            parts = parts._replace(controller=CONTROLLERS[controller])
        if seeker is not None:
            parts = parts._replace(seeker=None if seeker == NO_SEEKER else SEEKERS[seeker])
        elif not parts.controller.FOLLOWS:
            parts = parts._replace(seeker=None)
        found.append(parts)
    return found[::-1]


class Terms(eqx.Module):
    """All of a loop but the rails and the method; control knows the plant exactly."""

    plant: Plant
    driver: Driver
    sensors: Sensors
    train_speed: Float[Array, ""]  # at first, m/s
    slip: PerAxle  # at first, m/s
    slope: Float[Array, ""]  # of the track, rad

    def loop(self, method: Entrant | Case, rails: Rails) -> Loop:
        """The loop of a method on some rails."""
        return Loop(
            plant=self.plant,
            nominal=self.plant,
            rails=rails,
            driver=self.driver,
            sensors=self.sensors,
            observer=method.observer,
            seeker=method.seeker,
            controller=method.controller,
            train_speed=self.train_speed,
            slip=self.slip,
            slope=self.slope,
        )


def terms_of(system: System, plant: Plant, sensors: Sensors) -> Terms:
    """The terms of a system on a plant."""
    return Terms(
        plant=plant,
        driver=system.driver,
        sensors=sensors,
        train_speed=jnp.asarray(system.train_speed),
        slip=jnp.full(plant.radius.shape, system.slip),
        slope=jnp.asarray(system.slope),
    )


def built(system: System, case: Case, plant: Plant, noisy: bool = False) -> Loop:
    """The loop of a case."""
    sensors = Sensors(system.noise if noisy else None, period=case.sampled)
    return terms_of(system, plant, sensors).loop(case, case.rails)
