"""A user's knowledge of sensors and wheelset, and the force in the contact that follows with it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from adhesion_jax.data.columns import UNDECIDED
from adhesion_jax.data.rows import Rows
from adhesion_jax.data.stretches import slope_in_time, usual_step
from adhesion_jax.errors import InputError
from adhesion_jax.wording import number

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


TORQUE = "motor_torque_Nm"

#: The acceleration of the wheel is the change of its speed over about twice this time in s, for in
#: a shorter one it is noise, and in a longer one the beginning of a slip event is smoothed away.
_HALF_S = 0.075

#: Largest time between rows, in s, for which that change tells the acceleration.
_LARGEST_STEP_S = 0.25

#: Wheelsets whose inertia the force of a body contains; those of a locomotive are its driven axles.
_WHEELSETS = {"tangential_force_N": 0.5, "axle_force_N": 1.0, "locomotive_force_N": 0.0}


def force_of_torque(rows: Rows, known: Corrections) -> None:
    """Puts the force of an axle in the place of the torque of its motor.

        force = torque x gear ratio x efficiency / wheel radius

    in N, and in braking, where the torque is negative and the wheel drives the motor, over the
    efficiency instead. Torque [rows] in Nm. It is left out where a force or the adhesion was
    measured. InputError where it is the only force and gear ratio or radius are not given.
    """
    torque = rows.numbers.pop(TORQUE, None)
    ratio, radius, efficiency = known.gear_ratio, known.wheel_radius, known.efficiency
    if torque is None or {"adhesion", *UNDECIDED["force"]} & {*rows.numbers}:
        if torque is not None:
            rows.notes.append(
                "The motor torque is not used: force or adhesion has a column of its own."
            )
        given = {"gear ratio": ratio is not None, "efficiency": efficiency < 1}
        rows.notes += [
            f"The {name} is not used: no force had to be computed from a torque."
            for name in given
            if given[name]
        ]
        return
    if ratio is None or radius is None:
        lacking = [
            *(["--gear-ratio, the turns of the motor for one of the wheel"] if not ratio else []),
            *(["--wheel-radius in metres"] if not radius else []),
        ]
        raise InputError(
            f"the motor torque is the only force, and the force at the rail follows from it only "
            f"with gear ratio and wheel radius (give {' and '.join(lacking)})"
        )
    gain = np.where(torque >= 0, ratio * efficiency, ratio / efficiency)
    rows.numbers["axle_force_N"] = torque * gain / radius
    lost = f" x {efficiency:g} (in braking / {efficiency:g})" if efficiency < 1 else ""
    rows.notes.append(f"The force of the axle is motor torque x {ratio:g}{lost} / {radius:g} m.")


def without_inertia(rows: Rows, known: Corrections) -> np.ndarray:
    """Takes off the forces what turns the wheelset faster; which rows have a force, [rows], bool.

        force in the contact = force - wheelsets of the body x inertia x d(rotation)/dt / radius

    from the torque balance of a wheelset. The rotation is circumferential speed / radius; its
    derivative is the central difference over about 0.15 s and at least 3 rows, at the ends of a
    stretch without a gap that over half of it. InputError where force, time, speed of the wheel,
    radius or driven axles are lacking.
    """
    if known.inertia is None:
        return np.ones(rows.count, bool)
    columns, radius = rows.numbers, known.wheel_radius
    forces = [name for name in _WHEELSETS if name in columns]
    speed = columns.get("wheel_speed_mps")
    if speed is None and "wheel_rotation_radps" in columns and radius is not None:
        speed = radius * columns["wheel_rotation_radps"]
    lacking = []
    if "adhesion" in columns or not forces:
        lacking.append("a force in the place of the adhesion, from which nothing can be taken off")
    if "time_s" not in columns:
        lacking.append("a time (time_s)")
    if radius is None:
        lacking.append("the radius of the wheel (--wheel-radius in metres)")
    elif speed is None:
        lacking.append("the speed of the wheel (wheel_speed_mps or wheel_rotation_radps)")
    if forces == ["locomotive_force_N"] and "driven_axles" not in columns:
        lacking.append('the number of driven axles (--column "driven_axles=4", say)')
    if lacking or radius is None or speed is None:
        raise InputError(
            f"the inertia cannot be taken off the force, which needs {'; and '.join(lacking)}"
        )
    time, series = columns["time_s"], rows.series
    step = usual_step(time, series)
    if step > _LARGEST_STEP_S:
        raise InputError(
            f"the inertia cannot be taken off the force, because the rows are {step:g} s apart and "
            f"the acceleration of the wheel in a slip event needs at most {_LARGEST_STEP_S:g} s"
        )
    acceleration = slope_in_time(time, speed, series, _HALF_S)
    used = np.isfinite(acceleration)
    of_wheelset = known.inertia / radius**2 * np.where(used, acceleration, 0.0)
    for name in forces:
        columns[name] = columns[name] - (_WHEELSETS[name] or columns["driven_axles"]) * of_wheelset
    largest = float(np.quantile(np.abs(of_wheelset), 0.999))
    rows.notes.append(
        f"The inertia of the wheelset, {known.inertia:g} kg m2 at {radius:g} m, is taken off the "
        f"force: {number(largest)} N of an axle, which 1 row in 1000 exceeds."
    )
    if not used.all():
        rows.notes.append(
            f"Not used are {np.count_nonzero(~used):,} rows in stretches of time of one or two "
            "rows, which do not tell the acceleration of the wheel."
        )
    return used
