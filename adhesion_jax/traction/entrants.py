"""What is compared on equal terms: a seeker, a controller and an observer, with what is tuned."""

import inspect
from collections.abc import Mapping
from operator import attrgetter
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.curves.burckhardt import Burckhardt
from adhesion_jax.curves.kiencke import Kiencke
from adhesion_jax.identifiers import IDENTIFIERS
from adhesion_jax.plugins import object_of
from adhesion_jax.records import Known
from adhesion_jax.traction.box import Range
from adhesion_jax.traction.controllers import Controller
from adhesion_jax.traction.controllers.adaptive_robust import AdaptiveRobust
from adhesion_jax.traction.controllers.anticipating import Anticipating
from adhesion_jax.traction.controllers.linearised import Barrier
from adhesion_jax.traction.controllers.readhesion import DifferentialAcceleration
from adhesion_jax.traction.controllers.torque_feedback import SlopeFeedback
from adhesion_jax.traction.observers import Observer
from adhesion_jax.traction.observers.full_dimension import FullDimension
from adhesion_jax.traction.observers.sliding_modes import SuperTwisting
from adhesion_jax.traction.seekers import Seeker
from adhesion_jax.traction.seekers.climbing import (
    PerturbAndObserve,
    PrintedGradient,
    RepairedGradient,
    SlidingExtremum,
)
from adhesion_jax.traction.seekers.given import ConstantSlip, TrueOptimum
from adhesion_jax.traction.seekers.identified import Identified
from adhesion_jax.traction.seekers.of_numpy import seeker_of_numpy
from adhesion_jax.traction.seekers.offset_curve import OffsetCurve
from adhesion_jax.traction.seekers.robust_curve import RobustCurve
from adhesion_jax.traction.seekers.slewed import Slewed


class Entrant(NamedTuple):
    """The parts of a loop that are compared; without a seeker the controller is a whole law."""

    seeker: Seeker | None
    controller: Controller
    observer: Observer


def box(entrant: Entrant) -> Mapping[str, Range]:
    """The ranges of the numbers of an entrant that may be tuned, by their places in it."""
    of_parts = {
        "seeker": {} if entrant.seeker is None else entrant.seeker.box,
        "controller": entrant.controller.BOX,
        "observer": entrant.observer.BOX,
    }
    return {f"{part}.{name}": one for part, of in of_parts.items() for name, one in of.items()}


def numbers(entrant: Entrant) -> tuple[str, ...]:
    """The places of the numbers that may be tuned, in their order."""
    return tuple(box(entrant))


def configured(entrant: Entrant, unit: Float[Array, " numbers"]) -> Entrant:
    """The entrant at a point of the unit cube, whose axes are its ranges."""
    found = box(entrant)
    if not found:
        return entrant
    values = [one.at(share) for one, share in zip(found.values(), unit, strict=True)]
    places = [*map(attrgetter, found)]
    return eqx.tree_at(lambda parts: [place(parts) for place in places], entrant, values)


#: The slip at which all begin, and its bounds, m/s.
_START, _LOWEST, _HIGHEST = 0.1, 0.01, 0.6
_BOUNDS = {"start": _START, "lowest": _LOWEST, "highest": _HIGHEST}

#: The highest slip that any may have: beyond a second maximum, m/s.
_FURTHEST = 1.5

_OBSERVER = FullDimension(-500.0)


def sought(seeker: Seeker) -> Entrant:
    """A seeker under the terms that all share: start, slew limit, controller and observer."""
    return Entrant(_slewed(seeker), Barrier(), _OBSERVER)


def _slewed(seeker: Seeker) -> Slewed:
    return Slewed(seeker, start=_START, rate=2.0, lowest=_LOWEST, highest=_FURTHEST)


def _by(
    name: str, known: Known, spacing: float, block: int, ranges: Mapping[str, Range]
) -> Entrant:
    """An identifier as a seeker, every `spacing` seconds a sample, so many in a block."""
    return sought(
        Identified(
            IDENTIFIERS[name],
            known,
            dither=0.1,
            start=_START,
            threshold=0.015,
            spacing=spacing,
            block=block,
            ranges=tuple(ranges.items()),
        )
    )


#: Burckhardt's curve with all of it unknown, slip in m/s.
_BURCKHARDT = Known(
    Burckhardt(c1=0.3, c2=20.0, c3=0.3), [0.001, 2.0, 0.0], [2.0, 120.0, 5.0], slip_limit=_HIGHEST
)

#: Kiencke's curve in m/s, whose initial slope must be known: on rails on which it varies by a
#: factor of 30 there is no right value, and the best one is sought like other settings.
_KIENCKE = Known(
    Kiencke(a0=4.0, p1=0.0, p2=100.0),
    [-100.0, 2.8],
    [500.0, 1e4],
    slip_limit=_HIGHEST,
    by_sample=True,
)

_KIENCKE_FREE = Known(
    Kiencke(a0=4.0, p1=0.0, p2=100.0, free=("a0", "p1", "p2")),
    [0.2, -100.0, 2.8],
    [50.0, 500.0, 1e4],
    slip_limit=_HIGHEST,
    by_sample=True,
)

_FACTOR = {"identifier.factor": Range(0.99, 0.998)}
_SHORTER = {"identifier.factor": Range(0.9, 0.99)}
_LEVEL = {"identifier.level": Range(1e-7, 1e-2, log=True)}
_SPREAD = {"identifier.spread": Range(0.5, 2.0)}
_SLOPE = {"known.curve.a0": Range(1.0, 15.0, log=True)}


#: By name; the numbers are those before any tuning.
ENTRANTS: Mapping[str, Entrant] = {
    "true-optimum": sought(TrueOptimum()),
    "constant-slip": sought(ConstantSlip(_START)),
    "perturb-and-observe": sought(PerturbAndObserve(**_BOUNDS)),
    "gradient": sought(RepairedGradient(**_BOUNDS)),
    "sliding-extremum": sought(SlidingExtremum(**_BOUNDS)),
    "offset-curve": sought(OffsetCurve()),
    "robust-curve": Entrant(_slewed(RobustCurve(OffsetCurve())), Anticipating(), _OBSERVER),
    "varpro": _by("varpro-forgetting", _BURCKHARDT, 1e-3, 10, _FACTOR),
    "varpro-offset": _by("varpro-forgetting-offset", _BURCKHARDT, 1e-3, 10, _FACTOR),
    "bank-kiencke": _by("bank-kiencke", _KIENCKE, 0.01, 1, _SLOPE),
    "riv": _by("riv", _KIENCKE, 0.01, 1, _SLOPE),
    "qp": _by("qp-qian2024-1", _KIENCKE, 1e-3, 10, _SLOPE),
    "rls": _by("rls-kiencke-variable", _KIENCKE, 1e-3, 10, _SLOPE),
    "ml-pooled": _by("ml-pooled", _BURCKHARDT, 0.01, 5, _LEVEL),
    "kiencke-free": _by("kiencke-free", _KIENCKE_FREE, 0.01, 1, _SHORTER),
    "ekf": _by("ekf", _BURCKHARDT, 0.01, 1, _SPREAD),
    "differential-acceleration": Entrant(None, DifferentialAcceleration(), _OBSERVER),
    "slope-feedback": Entrant(None, SlopeFeedback(), _OBSERVER),
    "adaptive-robust": Entrant(
        _slewed(PrintedGradient(threshold=1e-2, switch=jnp.inf, start=_START)),
        AdaptiveRobust(),
        SuperTwisting(),
    ),
}


def entrant_of(told: str, found: Any) -> Entrant:
    """The method that a part of the user's own is: what it is not is that of all others.

    That is an object, or the one of a class without arguments; `told` is what a user calls it. One
    that is no part of a loop may be a seeker of NumPy. Raises InputError where it is none.
    """
    form = found if inspect.isclass(found) else type(found)
    if not issubclass(form, Seeker | Controller | Observer | Entrant):
        return sought(seeker_of_numpy(told, found))
    found = object_of(told, found)
    shared = ENTRANTS["offset-curve"]
    if isinstance(found, Seeker):
        return sought(found)
    if isinstance(found, Controller):
        seeker = shared.seeker if found.FOLLOWS else None
        return shared._replace(controller=found, seeker=seeker)
    return shared._replace(observer=found) if isinstance(found, Observer) else found
