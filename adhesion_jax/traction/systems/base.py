"""A published control system: its methods, its plant and its rails."""

import tomllib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp

from adhesion_jax.traction.controllers import CONTROLLERS, Controller
from adhesion_jax.traction.driver import Driver
from adhesion_jax.traction.entrants import Entrant
from adhesion_jax.traction.loop import Loop, Terms
from adhesion_jax.traction.observers import OBSERVERS, Observer
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.rails import Rails
from adhesion_jax.traction.seekers import SEEKERS, Seeker
from adhesion_jax.traction.seekers.given import TrueOptimum
from adhesion_jax.traction.sensors import Sensors, SpeedNoise


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
    duration: float  # s
    train_speed: float  # at first, m/s
    driver: Driver
    cases: Callable[[float], Sequence[Case]]  # on a grid of steps in s; the paper's own come first
    repairs: Sequence[str]  # sentences on equations that differ from the printed ones
    assumptions: Sequence[str]  # sentences on what the paper leaves open beside the plant
    control_period: float | None = 1e-3  # s; None: every step of the plant
    slip: float = 0.0  # at first, m/s
    slope: float = 0.0  # of the track, rad
    noise: SpeedNoise = SpeedNoise(0.02, 5e-3)  # assumed, because no paper gives it


def papers(name: str) -> Mapping[str, Any]:
    """The title, source, repairs and assumptions of a system, from the file beside it."""
    return tomllib.loads(Path(__file__).with_name(f"{name}.toml").read_text(encoding="utf-8"))


#: The name for the absence of a seeker.
NO_SEEKER = "none"


def with_parts(
    cases: Sequence[Case], observer: str | None, seeker: str | None, controller: str | None
) -> Sequence[Case]:
    """The paper's case of each scenario with the parts that are named; all cases if none is.

    That is the first that is not told the true optimum.

    A controller that follows no slip replaces the seeker too.
    """
    if observer is seeker is controller is None:
        return cases
    named = {"observer": observer, "seeker": seeker, "controller": controller}
    method = ", ".join(f"{part} {name}" for part, name in named.items() if name is not None)
    given: dict[str, Any] = {"method": method}
    if observer is not None:
        given["observer"] = OBSERVERS[observer]
    if controller is not None:
        given["controller"] = CONTROLLERS[controller]
    if seeker is not None:
        given["seeker"] = None if seeker == NO_SEEKER else SEEKERS[seeker]
    elif controller is not None and not CONTROLLERS[controller].FOLLOWS:
        given["seeker"] = None
    own = [case for case in cases if not isinstance(case.seeker, TrueOptimum)]
    firsts = {case.scenario: case for case in reversed(own)}
    return [case._replace(**given) for case in reversed(firsts.values())]


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
    method = Entrant(case.seeker, case.controller, case.observer)
    return terms_of(system, plant, sensors).loop(method, case.rails)
