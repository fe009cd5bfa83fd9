"""Identification of wheel-rail adhesion curves, and how well any method can know them.

`import adhesion_jax as aj` imports nothing else and sets nothing: what is named here is imported
when it is first used. The functions that do what commands do compute in double precision and on the
CPU whatever jax prefers; how to use them is told, with examples that run, in docs/python.md.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from adhesion_jax.curves import CURVES as CURVES
    from adhesion_jax.curves import Burckhardt as Burckhardt
    from adhesion_jax.curves import Curve as Curve
    from adhesion_jax.curves import Kiencke as Kiencke
    from adhesion_jax.data import SHIPPED as SHIPPED
    from adhesion_jax.effects import EFFECTS as EFFECTS
    from adhesion_jax.effects import Effect as Effect
    from adhesion_jax.effects.law import CorrectedLaw as CorrectedLaw
    from adhesion_jax.effects.saved import load_law as load_law
    from adhesion_jax.effects.saved import save_law as save_law
    from adhesion_jax.errors import InputError as InputError
    from adhesion_jax.identifiers import IDENTIFIERS as IDENTIFIERS
    from adhesion_jax.identifiers import Estimate as Estimate
    from adhesion_jax.identifiers import Identifier as Identifier
    from adhesion_jax.identifiers import Status as Status
    from adhesion_jax.library.discover import Discovery as Discovery
    from adhesion_jax.library.discover import discover as discover
    from adhesion_jax.library.identify import Identification as Identification
    from adhesion_jax.library.identify import identify as identify
    from adhesion_jax.library.montecarlo import MonteCarlo as MonteCarlo
    from adhesion_jax.library.montecarlo import montecarlo as montecarlo
    from adhesion_jax.library.online import Online as Online
    from adhesion_jax.library.online import OnlineEstimate as OnlineEstimate
    from adhesion_jax.library.online import online as online
    from adhesion_jax.library.plan import Planning as Planning
    from adhesion_jax.library.plan import plan as plan
    from adhesion_jax.library.sample import sample as sample
    from adhesion_jax.library.track import Track as Track
    from adhesion_jax.library.track import track as track
    from adhesion_jax.library.traction import Traction as Traction
    from adhesion_jax.library.traction import traction_control as traction_control
    from adhesion_jax.records import Known as Known
    from adhesion_jax.records import Record as Record
    from adhesion_jax.scenarios import SCENARIOS as SCENARIOS

#: Module to what is exported of it.
_EXPORTS = {
    "curves": ("CURVES", "Burckhardt", "Curve", "Kiencke"),
    "data": ("SHIPPED",),
    "effects": ("EFFECTS", "Effect"),
    "effects.law": ("CorrectedLaw",),
    "effects.saved": ("load_law", "save_law"),
    "errors": ("InputError",),
    "identifiers": ("IDENTIFIERS", "Estimate", "Identifier", "Status"),
    "library.discover": ("Discovery", "discover"),
    "library.identify": ("Identification", "identify"),
    "library.montecarlo": ("MonteCarlo", "montecarlo"),
    "library.online": ("Online", "OnlineEstimate", "online"),
    "library.plan": ("Planning", "plan"),
    "library.sample": ("sample",),
    "library.track": ("Track", "track"),
    "library.traction": ("Traction", "traction_control"),
    "records": ("Known", "Record"),
    "scenarios": ("SCENARIOS",),
}
_HOMES = {name: module for module, names in _EXPORTS.items() for name in names}

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    globals()[name] = value  # from now on it is found without asking here
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES})
