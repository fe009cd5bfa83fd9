"""The names and options that the command line must know, without importing what bears them.

They are asked of the rooms once, which takes seconds, and remembered under the source they are of.
"""

import os
import pickle
from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import NamedTuple

from adhesion_jax.keeping import folder, of_package
from adhesion_jax.options import Declared

#: Catalogues of other versions that stay beside the present one.
_OTHERS = 8


class Scenario(NamedTuple):
    words: str
    options: Mapping[str, Declared]


class Catalogue(NamedTuple):
    """Names in the order of the registries."""

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
    found = _remembered(path)
    if found is None:
        from adhesion_jax.command_line.registries import told

        found = told()
        _remember(path, pickle.dumps(found))
    return found


def _remembered(path: Path) -> Catalogue | None:
    """What lies there whole; None where there is nothing, or something damaged."""
    try:
        checksum, _, content = path.read_bytes().partition(b"\n")
    except OSError:
        return None
    if checksum.decode(errors="replace") != sha256(content).hexdigest():
        return None
    found: Catalogue = pickle.loads(content)
    return found


def _remember(path: Path, content: bytes) -> None:
    partly = path.with_suffix(f".{os.getpid()}")
    with suppress(OSError):  # where there is no room the next command asks the rooms again
        partly.write_bytes(f"{sha256(content).hexdigest()}\n".encode() + content)
        partly.replace(path)
        others = sorted(path.parent.glob("*.names"), key=os.path.getmtime, reverse=True)
        for old in others[1 + _OTHERS :]:
            old.unlink(missing_ok=True)
