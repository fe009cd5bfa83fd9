"""What a user knows of the sensors and of the wheelset that the columns of a log do not tell."""

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

from adhesion_jax.errors import InputError

#: The largest delay of a signal in s that is believed, of either sign.
LONGEST_DELAY = 10.0

_NONE: Mapping[str, float] = MappingProxyType({})


class Corrections(NamedTuple):
    """What is corrected before slip and adhesion are computed; nothing by default.

    `delays` are in s by the quantity: the value that a signal has at time t belongs to t less its
    delay. `inertia` is that of a wheelset with all that turns with it, about its axle. `gear_ratio`
    is the turns of the motor for one of the wheel, and `efficiency` that of motor gear and axle.
    """

    wheel_radius: float | None = None  # m
    delays: Mapping[str, float] = _NONE  # s
    inertia: float | None = None  # kg m^2
    gear_ratio: float | None = None
    efficiency: float = 1.0
    axles: bool = False  # columns with an index are those of axles


NOTHING = Corrections()


def corrections_of(
    wheel_radius: float | None = None,
    delays: Mapping[str, float] | None = None,
    inertia: float | None = None,
    gear_ratio: float | None = None,
    efficiency: float = 1.0,
    axles: bool = False,
) -> Corrections:
    """The same, checked; InputError names the value that cannot be meant, and what can."""
    positive = {"wheel radius": wheel_radius, "inertia": inertia, "gear ratio": gear_ratio}
    for name, value in positive.items():
        if value is not None and not 0 < value < math.inf:
            raise InputError(f"The {name} is {value:g}; give a number above 0.")
    if not 0 < efficiency <= 1:
        raise InputError(f"The efficiency is {efficiency:g}; give a number above 0 and up to 1.")
    for name, seconds in (delays or {}).items():
        if not abs(seconds) <= LONGEST_DELAY:
            raise InputError(
                f"The delay of {name} is {seconds:g} s; give a number of seconds between "
                f"-{LONGEST_DELAY:g} and {LONGEST_DELAY:g}."
            )
    return Corrections(wheel_radius, delays or _NONE, inertia, gear_ratio, efficiency, axles)
