"""The grid of time that all methods of a board share, and the versions of what its rows rest on."""

from collections.abc import Iterable, Mapping, Sequence
from hashlib import sha256
from inspect import getfile
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

import equinox as eqx
import jax
from jaxtyping import Array

from adhesion_jax.campaign.identity import settings_of
from adhesion_jax.errors import InputError
from adhesion_jax.metrics import closed_loop
from adhesion_jax.metrics.closed_loop import PRICES
from adhesion_jax.programs import kept
from adhesion_jax.traction import driver, integration, loop, rails, sensors, surface
from adhesion_jax.traction.entrants import Entrant
from adhesion_jax.traction.families import Family
from adhesion_jax.traction.loop import Terms, Timing, check, timing

#: Seconds from one sample of the sensors to the next.
SAMPLED = 1e-3

#: Step of the plant in s.
STEP = 2e-4

#: Number of drawn rails that the step is checked on.
_DRAWN = 64

#: What the version of the plant depends on beside the plant, and that of the rails.
_LOOP, _RAILS = (loop, integration, sensors, driver), (rails, surface)


class Grid(NamedTuple):
    """How time is divided, in s."""

    step: float = STEP
    control_period: float = 1e-3
    duration: float = 15.0


def timing_of(terms: Terms, grid: Grid, method: str, entrant: Entrant, family: Family) -> Timing:
    """The grid of a method's runs; InputError, which names it, where it has none."""
    try:
        rails = family.draw(jax.random.key(0), grid.step)
        drawn = _surfaces(family, grid.step)
        rails = eqx.tree_at(lambda one: jax.tree.leaves(one.surfaces), rails, drawn)
        loop = family.met(terms.loop(entrant, rails))
        check(loop)
        return timing(loop, *grid)
    except InputError as refusal:
        raise InputError(f"{method} cannot be judged: {refusal}") from None


@kept(static=(1,))
def _surfaces(family: Family, step: float) -> list[Array]:
    """The numbers of those of some drawn rails, on all of which the step must be short enough.

    Numbers alone: the form of a law is not found again in a program that another process has kept.
    """
    keys = jax.random.split(jax.random.key(0), _DRAWN)
    drawn = jax.vmap(lambda key: family.draw(key, step).surfaces)(keys)
    return [numbers.reshape(-1, *numbers.shape[2:]) for numbers in jax.tree.leaves(drawn)]


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


#: The methods that are told the slip of the largest utility at a price.
OPTIMA: Mapping[int, str] = {
    price: f"true-optimum-{price}" if price else "true-optimum" for price in PRICES
}


class Field(NamedTuple):
    """Methods by name, on equal terms and one grid of time."""

    terms: Terms
    timing: Timing
    entrants: Mapping[str, Entrant]

    def depends_on(self, families: Sequence[Family]) -> Mapping[str, str]:
        """What all numbers depend on beside the options of a job."""
        return {
            "--methods": ",".join(self.entrants),
            "settings of plant, methods and rails": settings_of(
                (self.terms, [*self.entrants.values()], [*families])
            ),
            "grid of time": repr(self.timing),
        }
