"""Identification of wheel-rail adhesion curves, and how well any method can know them.

`import adhesion_jax as aj` imports nothing else and sets nothing: what is named here is imported
when it is first used. The functions that do what commands do compute in double precision and on the
CPU whatever jax prefers; how to use them is told, with examples that run, in docs/python.md.
"""

import re
from importlib import import_module
from pathlib import Path

#: The modules of all names, from the stub that type checkers read.
_STUB = Path(__file__).with_name("__init__.pyi").read_text(encoding="utf-8")
_HOMES = {name: home for home, name in re.findall(r"^from (\S+) import (\w+)", _STUB, re.MULTILINE)}

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value  # from now on it is found without asking here
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES})
