"""The names and options that the command line must know, without importing what bears them.

They are asked of the rooms once, which takes seconds, and remembered under the source they are of.
"""

import json
import os
from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

from adhesion_jax.keeping import folder, of_package
from adhesion_jax.options import KINDS, Declared, Option

#: Catalogues of other versions that stay beside the present one.
_OTHERS = 8


class Scenario(NamedTuple):
    words: str
    options: Mapping[str, Declared]


class Catalogue(NamedTuple):
    """Names in the order of the registries; see `commands.names`."""

    scenarios: Mapping[str, Scenario]
    main_job: tuple[str, ...]
    identifiers: tuple[str, ...]
    ablations: tuple[str, ...]
    refusals: Mapping[str, Mapping[str, str]]  # of scenarios that need no option, by identifier
    not_following: Mapping[str, str]  # why an identifier cannot follow a log, by its name
    rails: tuple[str, ...]
    curves: tuple[str, ...]
    effects: tuple[str, ...]
    data: tuple[str, ...]
    systems: tuple[str, ...]
    plants: tuple[str, ...]
    observers: tuple[str, ...]
    seekers: tuple[str, ...]
    controllers: tuple[str, ...]


@cache
def catalogue() -> Catalogue:
    """The names of the package as it is."""
    path = folder() / f"{of_package()}.names"
    names = _remembered(path)
    if names is None:
        from adhesion_jax.commands.names import names as told

        names = told()
        _remember(path, json.dumps(names))
    return catalogue_of(names)


def catalogue_of(names: Mapping[str, Any]) -> Catalogue:
    """What `commands.names` tells, or what JSON has made of it."""
    scenarios = {
        name: Scenario(
            one["words"],
            {key: _declared(**option) for key, option in one["options"].items()},
        )
        for name, one in names["scenarios"].items()
    }
    rest = {name: tuple(value) for name, value in names.items() if isinstance(value, list)}
    refusals, not_following = names["refusals"], names["not_following"]
    return Catalogue(scenarios, refusals=refusals, not_following=not_following, **rest)


def _declared(kind: str, required: bool, option: Mapping[str, Any]) -> Declared:
    return Declared(KINDS[kind], Option(**option), required)


def _remembered(path: Path) -> Mapping[str, Any] | None:
    """What lies there whole; None where there is nothing, or something damaged."""
    try:
        told, _, text = path.read_bytes().partition(b"\n")
    except OSError:
        return None
    if told.decode(errors="replace") != sha256(text).hexdigest():
        return None
    found: Mapping[str, Any] = json.loads(text)
    return found


def _remember(path: Path, text: str) -> None:
    partly = path.with_suffix(f".{os.getpid()}")
    with suppress(OSError):  # where there is no room the next command asks the rooms again
        partly.write_text(f"{sha256(text.encode()).hexdigest()}\n{text}")
        partly.replace(path)
        others = sorted(path.parent.glob("*.names"), key=os.path.getmtime, reverse=True)
        for old in others[1 + _OTHERS :]:
            old.unlink(missing_ok=True)
