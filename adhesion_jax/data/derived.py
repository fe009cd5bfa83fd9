"""What follows from measured columns: adhesion, load, slip, radius of the wheel."""

from collections.abc import Mapping, Set
from typing import NamedTuple

import numpy as np

from adhesion_jax.data.columns import COLUMNS, QUANTITIES, UNDECIDED, plain
from adhesion_jax.data.forces import TORQUE, Corrections, force_of_torque, without_inertia
from adhesion_jax.data.plausible import radius_warnings, wrong_unit
from adhesion_jax.data.rows import Rows
from adhesion_jax.data.stretches import jackknife, stretches
from adhesion_jax.errors import InputError
from adhesion_jax.wording import listed, percent

#: What may be late under one word, whichever of these a log has.
_SIGNALS: Mapping[str, tuple[str, ...]] = {
    "force": (*UNDECIDED["force"], "motor_torque_Nm"),
    "load": UNDECIDED["load"],
    "wheel speed": ("wheel_speed_mps", "wheel_rotation_radps"),
}


def without_delays(rows: Rows, delays: Mapping[str, float]) -> None:
    """Moves signals to their time, and keeps the rows that still have a value.

        corrected(t) = recorded(t + delay)

    by linear interpolation between the rows of one run and axle without a gap. The last rows of
    such a stretch have no value, or the first where the delay is negative. `delays` are in s by
    quantity or word, such as force. InputError without a time, and where no column is what is said
    to be late.
    """
    if not delays:
        return
    columns = rows.numbers
    time = columns.get("time_s")
    if time is None:
        raise InputError(
            f"the delay of {listed([*delays])} cannot be taken out, because there is no time "
            '(name its column, as by --column "time=COLUMN [s]")'
        )
    late = {name: by for word, by in delays.items() for name in _columns_of(word, columns)}
    _compute_anew(rows, {*late})
    used = np.ones(time.size, bool)
    for part in stretches(time, rows.series):
        there = time[part]
        for name, seconds in late.items():
            at = there + seconds
            columns[name][part] = np.interp(at, there, columns[name][part])
            used[part] &= (at >= there[0]) & (at <= there[-1])
    for name, seconds in late.items():
        moved = f"{COLUMNS[name].plain.replace('_', ' ')} is moved by {abs(seconds):g} s"
        to = "earlier" if seconds >= 0 else "later"
        rows.notes.append(f"As it was said to be late, the {moved} to {to} times.")
    rows.leave(~used, "a signal that was moved has no value")


def _compute_anew(rows: Rows, late: set[str]) -> None:
    """Takes out slip and adhesion where their sources are late, to be computed.

    InputError where the slip or the adhesion stands in a column of its own, and cannot be computed
    anew: moving a source of it would change nothing.
    """
    speeds = ("vehicle_speed_mps", *_SIGNALS["wheel speed"])
    for results, sources, what in (
        (("slip_ratio", "slip_velocity_mps"), speeds, "slip"),
        (("adhesion",), (*_SIGNALS["force"], *_SIGNALS["load"]), "adhesion"),
    ):
        there = {*results} & {*rows.numbers}
        if not there or there & late or not {*sources} & late:
            continue
        without = {*rows.numbers} - there
        if any(f"column {results[0]} " in clause for clause in needed(without)[1]):
            raise InputError(
                f"moving {listed(sorted({*sources} & late))} changes nothing, because the {what} "
                f"stands in a column of its own, {listed(sorted(there))}, and there is not all "
                "that it comes from (name a file with it, or leave out the delay)"
            )
        for name in there:
            del rows.numbers[name]
        rows.notes.append(
            f"The {what} is computed anew in the place of {listed(sorted(there))}, because what it "
            "comes from was late."
        )


def _columns_of(word: str, columns: Mapping[str, np.ndarray]) -> tuple[str, ...]:
    """The columns that are late under a word; InputError where there is none."""
    called = plain(word)
    names = (word,) if word in COLUMNS else _SIGNALS.get(called, QUANTITIES.get(called, ()))
    if "time_s" in names or (not names and called):
        known = [*(one.replace(" ", "_") for one in _SIGNALS), "vehicle_speed"]
        raise InputError(f"{word} is no signal that may be late (name {listed(known, 'or')})")
    there = tuple(name for name in names if name in columns)
    if not there:
        raise InputError(
            f"the delay of {word} cannot be taken out, because there is no column of it (there "
            f"are {', '.join(sorted(columns))})"
        )
    return there


#: Below this speed, in m/s, a vehicle on rails stands or creeps, and its slip is mostly noise. That
#: of a slow rig is less: this share of its largest speed, or this multiple of the noise of it.
_SLOWEST, _OF_LARGEST, _OF_NOISE = 0.5, 0.05, 10.0

#: Force, the load of the same body, and the wheels of the body; those of a locomotive are told by
#: its driven axles.
_BODIES = (
    ("tangential_force_N", "normal_load_N", 1),
    ("axle_force_N", "axle_load_N", 2),
    ("locomotive_force_N", "locomotive_load_N", 0),
)
_AXLES = "driven_axles"

#: The rolling radius is found from rows whose adhesion is at most this share of the largest; within
#: the smaller share the wheel counts as coasting, and this is the fewest rows in which it must.
_LOW = 0.2
_COASTING = 0.05
_FEWEST = 100
#: Contiguous groups of rows from whose scatter its standard error is taken.
_GROUPS = 20

#: Columns from which the slip comes, and the adhesion: the first that are all there.
_SLIP = (
    ("slip_ratio",),
    ("slip_velocity_mps", "vehicle_speed_mps"),
    ("wheel_speed_mps", "vehicle_speed_mps"),
    ("wheel_rotation_radps", "vehicle_speed_mps"),
    ("slip_velocity_mps",),
    ("slip_angle_deg",),
)
_OF_WHEEL = {"wheel_speed_mps", "wheel_rotation_radps"}
_ADHESION = (
    ("adhesion",),
    *((force, load) for force, load, _ in _BODIES),
    ("tangential_force_N", "axle_load_N"),
    ("axle_force_N", "normal_load_N"),
    ("tangential_force_N", "locomotive_load_N", _AXLES),
    ("axle_force_N", "locomotive_load_N", _AXLES),
    ("locomotive_force_N", "normal_load_N", _AXLES),
    ("locomotive_force_N", "axle_load_N", _AXLES),
    (TORQUE, "axle_load_N"),
    (TORQUE, "normal_load_N"),
    (TORQUE, "locomotive_load_N", _AXLES),
)
_NO_SLIP = (
    "the column slip_ratio (or slip_velocity_mps, or vehicle_speed_mps with wheel_speed_mps or "
    "wheel_rotation_radps, or slip_angle_deg of a tyre) is missing"
)
_NO_ADHESION = (
    "the column adhesion (or tangential_force_N with normal_load_N, or force and load of an axle "
    "or of the locomotive, or motor_torque_Nm and a load) is missing"
)

#: All of them.
SOURCES = frozenset(name for way in (*_SLIP, *_ADHESION) for name in way)

Columns = dict[str, np.ndarray]


class Radius(NamedTuple):
    """Rolling radius of the wheel in m, from this many rows."""

    metres: float
    standard_error: float
    rows: int


def needed(names: Set[str]) -> tuple[list[str], list[str]]:
    """The columns of these from which slip and adhesion come, and what is missing, as clauses."""
    found: list[str] = []
    missing: list[str] = []
    # A wheel whose speed is measured may have a slip angle beside its slip.
    of_slip = _SLIP[:-1] if names & _OF_WHEEL else _SLIP
    for ways, clause in ((of_slip, _NO_SLIP), (_ADHESION, _NO_ADHESION)):
        way = next((way for way in ways if names >= {*way}), None)
        if way is not None:
            found += way
        elif asked := [way for way in ways if way[-1] == _AXLES and names >= {*way[:-1]}]:
            force, load, _ = asked[0]
            missing.append(
                f"{force} and {load} go together only by the number of driven axles of the "
                'locomotive (say it, as by --column "driven_axles=4")'
            )
        elif alone := sorted(names & {one for way in ways for one in way}):
            missing.append(f"{clause}, {' and '.join(alone)} alone will not do")
        else:
            missing.append(clause)
    return list(dict.fromkeys(found)), missing


def derive(rows: Rows, known: Corrections) -> None:
    """Adds to the columns what follows from them, and takes out what has served its purpose.

        adhesion = force / load, of the same body; an axle has two wheels, a locomotive two for
            each driven axle
        normal load = axle load / 2, or locomotive load / 2 / driven axles
        circumferential speed = radius x angular speed of the wheel
        slip velocity = circumferential speed - vehicle speed
        slip ratio = slip velocity / vehicle speed, or tan(slip angle) where a tyre is steered

    so that slip, like adhesion, is positive in traction and negative in braking. The force may be
    that of a motor torque, and the inertia of the wheelset is taken off it (`forces`). Rows in
    which the vehicle is slower than `slowest` are not used where the slip is a ratio. InputError
    where the radius is neither given nor to be found, and where no row is used.
    """
    columns = rows.numbers
    force_of_torque(rows, known)
    used = without_inertia(rows, known)

    def add(name: str, values: np.ndarray, source: str) -> None:
        columns[name] = values
        rows.computed[name] = source

    if "adhesion" not in columns:
        add("adhesion", *_adhesion(columns))
    if "normal_load_N" not in columns:
        if "axle_load_N" in columns:
            add("normal_load_N", _of_wheel(columns, "axle_load_N"), "axle_load_N / 2")
        elif {"locomotive_load_N", _AXLES} <= {*columns}:
            of_all = "locomotive_load_N / (2 x driven_axles)"
            add("normal_load_N", _of_wheel(columns, "locomotive_load_N"), of_all)
    if not ({"slip_ratio", "slip_velocity_mps"} | _OF_WHEEL) & {*columns}:
        angle = np.radians(columns.pop("slip_angle_deg"))
        add("slip_ratio", np.tan(angle), "tangent of slip_angle_deg")
    speed = columns.get("vehicle_speed_mps")
    without_slip = not {"slip_ratio", "slip_velocity_mps"} & {*columns}
    if without_slip:
        _check_signs(columns)
    if without_slip and "wheel_speed_mps" not in columns:
        radius = known.wheel_radius or _found_radius(rows)
        rotation = columns["wheel_rotation_radps"]
        add("wheel_speed_mps", radius * rotation, f"{radius:.5g} m x rotation")
    elif known.wheel_radius is not None and known.inertia is None and known.gear_ratio is None:
        rows.notes.append(
            "The wheel radius is not used: no slip had to be computed from a rotation."
        )
    if without_slip:
        _check_speeds(columns["wheel_speed_mps"], columns["vehicle_speed_mps"])
        velocity = columns["wheel_speed_mps"] - columns["vehicle_speed_mps"]
        add("slip_velocity_mps", velocity, "wheel speed - train speed")
    unused = "no row has a force from which the inertia could be taken off"
    if speed is not None:
        limit = slowest(speed, columns.get("time_s"))
        moves = speed >= limit
        slow = f"the train is slower than {limit:.2g} m/s, where the slip is mostly noise"
        backwards = speed <= -limit
        unused = f"{slow}, in every row (check the unit and the sign of its speed)"
        if speed.min() <= -_SLOWEST:
            unused = (
                "the train stands or runs backwards in every row, as its speed is negative (turn "
                'its sign by --column "vehicle_speed=-COLUMN", and that of the wheel where it is '
                "negative too)"
            )
        rows.tell(backwards, "the train runs backwards, as its speed is negative")
        rows.tell(~moves & ~backwards, slow)
        used &= moves
    if "slip_ratio" not in columns and speed is not None:
        ratio = columns["slip_velocity_mps"] / np.where(moves, speed, 1.0)
        add("slip_ratio", ratio, "slip velocity / train speed")
    elif speed is None and {"slip_ratio", "slip_velocity_mps"} <= {*columns}:
        add("vehicle_speed_mps", _speed(columns), "slip velocity / slip ratio")
    # Before the next column is made: those of a long log fill the memory.
    spent = ("wheel_speed_mps", "wheel_rotation_radps", "axle_force_N", "locomotive_force_N")
    for name in (*spent, "axle_load_N", "locomotive_load_N", _AXLES):
        columns.pop(name, None)
        rows.computed.pop(name, None)
    if not used.any():
        raise InputError(unused)
    rows.keep(used)


def _found_radius(rows: Rows) -> float:
    """The rolling radius where it was not given, and sentences on it."""
    speed, adhesion = rows.numbers["vehicle_speed_mps"], rows.numbers["adhesion"]
    found = rolling_radius(rows.numbers["wheel_rotation_radps"], speed, adhesion)
    rows.notes += [
        f"The rolling radius of the wheel is {found.metres:.5f} ± {found.standard_error:.2g} m "
        "(standard error), the train speed over the rotation at adhesion 0, from "
        f"{found.rows:,} rows of at most {percent(_LOW)} of the largest adhesion.",
        *radius_warnings(found.metres),
    ]
    return found.metres


def slowest(speed: np.ndarray, time: np.ndarray | None) -> float:
    """The speed in m/s below which the slip is mostly noise, of speeds [rows].

    It is a twentieth of the largest (that of 1 row in 1000), in a log with a time at least ten
    times the noise, and at most 0.5 m/s. The noise is told by the second differences of rows that
    follow each other, robustly.
    """
    of_largest = _OF_LARGEST * float(np.quantile(speed, 0.999))
    noise = 0.0
    if time is not None and speed.size > 2:
        noise = 1.4826 * float(np.median(np.abs(np.diff(speed, 2)))) / np.sqrt(6)
    return min(_SLOWEST, max(of_largest, _OF_NOISE * noise, np.finfo(float).tiny))


def _adhesion(columns: Columns) -> tuple[np.ndarray, str]:
    for force, load, _ in _BODIES:
        if force in columns and load in columns:
            return columns[force] / columns[load], f"{force} / {load}"
    force = next(force for force, _, _ in _BODIES if force in columns)
    load = next(load for _, load, _ in _BODIES if load in columns)
    return _of_wheel(columns, force) / _of_wheel(columns, load), f"{force} / {load}, for one wheel"


def _of_wheel(columns: Columns, name: str) -> np.ndarray:
    """A force or load of a body, over the number of its wheels."""
    wheels = next(number for *of_body, number in _BODIES if name in of_body)
    return columns[name] / (wheels or 2 * columns[_AXLES])


def _check_signs(columns: Columns) -> None:
    """InputError where the wheel turns the other way than the train runs."""
    train = columns["vehicle_speed_mps"]
    name = "wheel_speed_mps" if "wheel_speed_mps" in columns else "wheel_rotation_radps"
    fast = train >= slowest(train, None)
    if fast.any() and np.median(columns[name][fast]) < 0:
        raise InputError(
            "the wheel turns the other way than the train runs in most rows (turn the sign of the "
            f'wheel by --column "{COLUMNS[name].plain}=-COLUMN", or that of the train)'
        )


def _check_speeds(wheel: np.ndarray, train: np.ndarray) -> None:
    """InputError where one of the two speeds is km/h and the other m/s throughout."""
    fast = train >= slowest(train, None)
    factor = float(np.median(wheel[fast] / train[fast])) if fast.any() else 1.0
    if wrong := wrong_unit(factor):
        raise InputError(
            f"the wheel is {factor:.2g} times as fast as the train in most rows, as if in "
            f"one of the two columns {wrong} (say the units of both, as by --column "
            '"wheel_speed=COLUMN [km/h]")'
        )


def _speed(columns: Columns) -> np.ndarray:
    slips = columns["slip_ratio"] != 0
    ratio = np.where(slips, columns["slip_ratio"], 1.0)
    speed = np.abs(columns["slip_velocity_mps"] / ratio)
    # At slip 0 adhesion does not depend on the speed: any finite value will do there.
    return np.where(slips, speed, np.median(speed[slips]) if slips.any() else 0.0)


def rolling_radius(rotation: np.ndarray, speed: np.ndarray, adhesion: np.ndarray) -> Radius:
    """Rolling radius of a wheel from its rotation in rad/s and the train speed in m/s, [rows].

    At small adhesion slip is proportional to it, so that

        speed / rotation = radius (1 - k adhesion)

    and a straight line through the rows of at most 20 % of the largest adhesion (that of 1 in 1000
    rows), at least a quarter as fast as the fastest, has the radius at adhesion 0. Rows more than
    five median deviations from the line are left out once. The standard error is that of the
    jackknife over 20 contiguous groups of rows, for neighbouring rows say nearly the same.
    InputError where fewer than 100 rows have 5 % of the largest adhesion or less: it did not coast.
    """
    size = np.abs(adhesion)
    largest = np.quantile(size, 0.999)
    fast = (speed >= speed.max() / 4) & (rotation > 0)
    low = np.flatnonzero(fast & (size <= _LOW * largest))
    if np.count_nonzero(size[low] <= _COASTING * largest) < _FEWEST:
        raise InputError(
            "the wheel radius cannot be identified, because fewer than "
            f"{_FEWEST} rows have an adhesion of at most {percent(_COASTING)} of the largest (give "
            "--wheel-radius in metres, or a log in which the wheel coasts)"
        )
    ratio, level = speed[low] / rotation[low], adhesion[low]
    off = np.abs(ratio - np.polyval(np.polyfit(level, ratio, 1), level))
    near = off <= 5 * np.median(off)
    ratio, level = ratio[near], level[near]
    group = np.arange(ratio.size) * _GROUPS // ratio.size
    without = [np.polyfit(level[group != g], ratio[group != g], 1)[1] for g in range(_GROUPS)]
    radius = float(np.polyfit(level, ratio, 1)[1])
    return Radius(radius, jackknife(without), int(ratio.size))
