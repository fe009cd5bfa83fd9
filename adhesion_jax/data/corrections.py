"""What a user knows of the sensors and of the wheelset that the columns of a log do not tell."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from adhesion_jax.errors import InputError

#: The largest delay of a signal in s that is believed, of either sign.
LONGEST_DELAY = 10.0


@dataclass(frozen=True)
class Corrections:
    """What is corrected before slip and adhesion are computed; nothing by default.

    `delays` are in s by the quantity: the value that a signal has at time t belongs to t less its
    delay. `inertia` is that of a wheelset with all that turns with it, about its axle. `gear_ratio`
    is the turns of the motor for one of the wheel, and `efficiency` that of motor gear and axle.
    InputError names the value that cannot be meant, and what can.
    """

    wheel_radius: float | None = None  # m
    delays: Mapping[str, float] = field(default_factory=dict)  # s
    inertia: float | None = None  # kg m^2
    gear_ratio: float | None = None
    efficiency: float = 1.0
    axles: bool = False  # columns with an index are those of axles

    def __post_init__(self) -> None:
        for name in ("wheel_radius", "inertia", "gear_ratio"):
            value = getattr(self, name)
            if value is not None and not 0 < value < math.inf:
                what = name.replace("_", " ")
                raise InputError(f"The {what} is {value:g}; give a number above 0.")
        if not 0 < self.efficiency <= 1:
            raise InputError(
                f"The efficiency is {self.efficiency:g}; give a number above 0 and up to 1."
            )
        for name, seconds in self.delays.items():
            if not abs(seconds) <= LONGEST_DELAY:
                raise InputError(
                    f"The delay of {name} is {seconds:g} s; give a number of seconds between "
                    f"-{LONGEST_DELAY:g} and {LONGEST_DELAY:g}."
                )


NOTHING = Corrections()
