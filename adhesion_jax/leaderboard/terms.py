"""What all methods of a board share: train, sensors, demand, start, and the grid of time."""

from collections.abc import Iterable
from hashlib import sha256
from inspect import getfile
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.campaign.identity import settings_of
from adhesion_jax.errors import InputError
from adhesion_jax.metrics import closed_loop
from adhesion_jax.programs import kept
from adhesion_jax.traction import driver, integration, loop, rails, sensors, surface
from adhesion_jax.traction.driver import Driver
from adhesion_jax.traction.entrants import Entrant
from adhesion_jax.traction.families import Family
from adhesion_jax.traction.loop import Loop, Timing, check, timing
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.rails import Rails
from adhesion_jax.traction.sensors import Sensors
from adhesion_jax.traction.signals import PerAxle
from adhesion_jax.traction.surface import RailSurface
from adhesion_jax.traction.systems.base import System

#: Seconds from one sample of the sensors to the next.
SAMPLED = 1e-3

#: Step of the plant in s.
STEP = 2e-4

#: Number of drawn rails that the step is checked on.
_DRAWN = 64

#: What the version of the plant depends on beside the plant, and that of the rails.
_LOOP, _RAILS = (loop, integration, sensors, driver), (rails, surface)


class Terms(eqx.Module):
    """All of a loop but the rails and the method."""

    plant: Plant
    driver: Driver
    sensors: Sensors
    train_speed: Float[Array, ""]  # at first, m/s
    slip: PerAxle  # at first, m/s
    slope: Float[Array, ""]  # of the track, rad

    def loop(self, entrant: Entrant, rails: Rails) -> Loop:
        """The loop of a method on some rails; control knows the plant exactly."""
        return Loop(
            plant=self.plant,
            nominal=self.plant,
            rails=rails,
            driver=self.driver,
            sensors=self.sensors,
            observer=entrant.observer,
            seeker=entrant.seeker,
            controller=entrant.controller,
            train_speed=self.train_speed,
            slip=self.slip,
            slope=self.slope,
        )


def terms_of(system: System, plant: Plant) -> Terms:
    """The terms of a system, whose noise is in force, on a plant."""
    return Terms(
        plant=plant,
        driver=system.driver,
        sensors=Sensors(system.noise, period=SAMPLED),
        train_speed=jnp.asarray(system.train_speed),
        slip=jnp.full(plant.radius.shape, system.slip),
        slope=jnp.asarray(system.slope),
    )


class Grid(NamedTuple):
    """How time is divided, in s."""

    step: float = STEP
    control_period: float = 1e-3
    duration: float = 15.0


def timing_of(terms: Terms, grid: Grid, method: str, entrant: Entrant, family: Family) -> Timing:
    """The grid of a method's runs; InputError, which names it, where it has none."""
    try:
        rails = family.draw(jax.random.key(0), grid.step)
        rails = eqx.tree_at(lambda one: one.surfaces, rails, _surfaces(family, grid.step))
        loop = family.met(terms.loop(entrant, rails))
        check(loop)
        return timing(loop, *grid)
    except InputError as refusal:
        raise InputError(f"{method} cannot be judged: {refusal}") from None


@kept(static=(1,))
def _surfaces(family: Family, step: float) -> RailSurface:
    """Those of some drawn rails, on all of which the step must be short enough."""
    keys = jax.random.split(jax.random.key(0), _DRAWN)
    drawn = jax.vmap(lambda key: family.draw(key, step).surfaces)(keys)
    return jax.tree.map(lambda numbers: numbers.reshape(-1, *numbers.shape[2:]), drawn)


class Versions(NamedTuple):
    """What a row depends on beside its method: rows that differ here are not compared."""

    plant: str  # train, sensors, demand and grid of time, and the loop that joins them
    rails: str
    metrics: str


def versions_of(terms: Terms, grid: Grid, family: Family) -> Versions:
    """The versions of the rows of a board."""
    return Versions(
        _version((settings_of(terms), repr(grid)), (*_LOOP, *_classes(terms.plant))),
        _version((settings_of(family),), (*_RAILS, *_classes(family))),
        _version((), (closed_loop,)),
    )


def _classes(of: eqx.Module) -> list[type]:
    """Its class and those that it is derived from, but not those of the library of classes."""
    return [one for one in type(of).__mro__ if issubclass(one, eqx.Module) and one != eqx.Module]


def _version(numbers: Iterable[str], parts: Iterable[ModuleType | type]) -> str:
    """Eight digits that change where a number does, or the source of a part."""
    content = sha256("".join(numbers).encode())
    for part in parts:
        content.update(Path(getfile(part)).read_bytes())
    return content.hexdigest()[:8]
