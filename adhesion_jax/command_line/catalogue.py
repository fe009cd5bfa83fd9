"""The names and options that the command line must know, without importing what bears them.

They are asked of the rooms once, which takes seconds, and remembered under the source they are of.
"""

import os
import pickle
from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from importlib import import_module
from typing import NamedTuple

from adhesion_jax.command_line.command import start
from adhesion_jax.keeping import folder, keep, kept, of_package
from adhesion_jax.options import Declared

#: Catalogues of other versions that stay beside the present one.
_OTHERS = 8

#: The room and the mapping there, or the function that gives it, that has the names of a kind.
_REGISTRIES = {
    "main_job": ("campaign.job", "MAIN_JOB"),
    "identifiers": ("identifiers", "IDENTIFIERS"),
    "ablations": ("identifiers", "ABLATIONS"),
    "rails": ("scenarios.rails", "RAILS"),
    "curves": ("curves", "CURVES"),
    "effects": ("effects", "EFFECTS"),
    "data": ("data", "SHIPPED"),
    "systems": ("traction.systems", "SYSTEMS"),
    "plants": ("traction.plants.reading", "shipped"),
    "observers": ("traction.observers", "OBSERVERS"),
    "seekers": ("traction.seekers", "SEEKERS"),
    "controllers": ("traction.controllers", "CONTROLLERS"),
    "entrants": ("traction.entrants", "ENTRANTS"),
    "families": ("traction.families", "FAMILIES"),
}


class Scenario(NamedTuple):
    words: str
    options: Mapping[str, Declared]


class Catalogue(NamedTuple):
    """What is known of the rooms."""

    names: Mapping[str, tuple[str, ...]]  # by the kind of part, in the order of the registry
    scenarios: Mapping[str, Scenario]
    refusals: Mapping[str, Mapping[str, str]]  # of scenarios that need no option, by identifier
    not_following: Mapping[str, str]  # why an identifier cannot follow a log, by its name


@cache
def catalogue() -> Catalogue:
    """The catalogue of the package as it is."""
    path = folder() / f"{of_package()}.names"
    remembered = kept(path)
    if remembered is not None:
        found: Catalogue = pickle.loads(remembered)
        return found
    # Scenarios compute when they are asked: the flags are set before that, for jax reads them once.
    start()
    found = told()
    keep(path, pickle.dumps(found))
    with suppress(OSError):
        for old in sorted(path.parent.glob("*.names"), key=os.path.getmtime)[: -1 - _OTHERS]:
            old.unlink(missing_ok=True)
    return found


def told() -> Catalogue:
    """What the rooms have now; an identifier may refuse a scenario, which no option changes."""
    from adhesion_jax.identifiers import IDENTIFIERS
    from adhesion_jax.measured.following import refusal
    from adhesion_jax.options import declared
    from adhesion_jax.scenarios import SCENARIOS, build, needs_options
    from adhesion_jax.traction.systems.base import NO_SEEKER

    names = {kind: _names(*of) for kind, of in _REGISTRIES.items()}
    known = {name: build(name).known for name in SCENARIOS if not needs_options(name)}
    return Catalogue(
        {**names, "seekers": (NO_SEEKER, *names["seekers"])},
        {
            name: Scenario((function.__doc__ or "").partition("\n")[0], dict(declared(function)))
            for name, function in SCENARIOS.items()
        },
        {
            scenario: _stated({name: one.accepts(of) for name, one in IDENTIFIERS.items()})
            for scenario, of in known.items()
        },
        _stated({name: refusal(one) for name, one in IDENTIFIERS.items()}),
    )


def _names(room: str, registry: str) -> tuple[str, ...]:
    found = getattr(import_module(f"adhesion_jax.{room}"), registry)
    return tuple(found() if callable(found) else found)


def _stated(reasons: Mapping[str, str | None]) -> Mapping[str, str]:
    return {name: reason for name, reason in reasons.items() if reason is not None}
