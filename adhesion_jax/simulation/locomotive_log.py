"""A day of a locomotive as its logger writes it: trips and stops at 100 Hz, a few slip events."""

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import pyarrow
import pyarrow.compute
import pyarrow.parquet
from scipy.signal import lfilter

from adhesion_jax.curves.burckhardt import Burckhardt
from adhesion_jax.errors import InputError

#: Seconds between two rows.
STEP_S = 0.01

#: Standard deviation of the white noise of the wheel speed, m/s, and of the AR(1) noise of adhesion
#: with its correlation from row to row.
WHEEL_SPEED_NOISE_MPS, SIGMA, AUTOCORRELATION = 0.02, 0.008, 0.5

#: The columns of the export: what they are of, how much larger its unit is, digits after the comma.
_EXPORT = {
    "v [km/h]": ("vehicle_speed_mps", 1 / 3.6, 2),
    "v_Rad [km/h]": ("wheel_speed_mps", 1 / 3.6, 2),
    "Zugkraft [kN]": ("tangential_force_N", 1000.0, 2),
    "Achslast [kN]": ("normal_load_N", 1000.0, 1),
    "rH (%)": ("relative_humidity_pct", 1.0, 1),
    "T [°C]": ("temperature_C", 1.0, 1),
}
_BEGIN = np.datetime64("2024-03-18T06:00:00.000", "ms")
_AXLE_LOAD_N = 210e3

#: Rows that are drawn and written at a time.
_ROWS = 250_000


class LogCourse(NamedTuple):
    """The slip, events and columns of a log, before any adhesion; arrays of one shape."""

    slip: np.ndarray  # true
    event: np.ndarray  # whether the point lies in a slip event
    columns: Mapping[str, np.ndarray]


def burckhardt(law: Burckhardt, slip: np.ndarray) -> np.ndarray:
    """c1 (1 - exp(-c2 |l|)) - c3 |l|, odd in l."""
    size = np.abs(slip)
    rise = -float(law.c1) * np.expm1(-float(law.c2) * size)
    return np.asarray(np.sign(slip) * (rise - float(law.c3) * size))


def dry(amount: float, course: LogCourse) -> np.ndarray:
    """Adhesion falls with humidity: exp(-a (H - 65 %)/20 %)."""
    return np.exp(-amount * (course.columns["relative_humidity_pct"] - 65) / 20)


def falling(amount: float, course: LogCourse) -> np.ndarray:
    """(1 + w/w0)^-a, w the slip velocity in m/s, w0 = .2 m/s: steep at first, flat later."""
    velocity = np.abs(course.slip) * course.columns["vehicle_speed_mps"]
    return (1 + velocity / 0.2) ** -amount


#: Effects that can be planted: how strong they are, and the factor on adhesion that they make.
EFFECTS = {"humidity": (0.15, dry), "falling_friction": (0.3, falling)}


class LocomotiveLog(NamedTuple):
    """What a log is drawn from; `tables` draws its rows."""

    seed: int
    rows: int
    curve: Burckhardt
    #: [corners] time, speed of the vehicle and adhesion that the driver asks for, straight between.
    corners: np.ndarray
    #: [events] when an event begins, how long it takes, slip ratio of its top above the micro-slip.
    events: np.ndarray
    waves: np.ndarray  # phases of weather and load
    effects: tuple[str, ...]


def locomotive_log(
    *, seed: int, hours: float = 8.0, events: int = 5, effects: Sequence[str] = ()
) -> LocomotiveLog:
    """Trips of 60 to 100 km/h with stops between, over a rail of one Burckhardt curve.

    Between the events slip is the micro-slip at which the curve gives the adhesion that is asked
    for; an event is a smooth bump of 4 to 8 s to a slip of .08 to .25 while the train accelerates
    at 3 to 16 m/s. InputError for an effect that is not known, or hours without a row or with room
    for fewer events.
    """
    for name in effects:
        if name not in EFFECTS:
            raise InputError(f"There is no effect '{name}' of a log; name {' or '.join(EFFECTS)}.")
    rows = round(3600.0 * hours / STEP_S)
    if rows < 1:
        raise InputError(
            f"A log of {hours:g} h has no row, one each {STEP_S:g} s; give more hours."
        )
    chance = np.random.default_rng((seed, 0))
    level = chance.uniform(0.25, 0.4)
    curve = Burckhardt(
        c1=level, c2=chance.uniform(60.0, 120.0), c3=level * chance.uniform(0.6, 1.2)
    )
    corners, rooms = _trips(3600.0 * hours, chance)
    if events > len(rooms):
        raise InputError(
            f"A log of {hours:g} h has room for {len(rooms)} slip events, not {events}; "
            "give more hours or fewer events."
        )
    chosen = rooms[np.sort(chance.permutation(len(rooms))[:events])]
    length = chance.uniform(4.0, 8.0, events)
    begin = chance.uniform(chosen[:, 0], np.maximum(chosen[:, 1] - length, chosen[:, 0]))
    tops = chance.uniform(0.08, 0.25, events)
    return LocomotiveLog(
        seed,
        rows,
        curve,
        corners,
        np.stack([begin, length, tops], axis=1),
        chance.uniform(0, 2 * np.pi, 4),
        tuple(effects),
    )


def tables(log: LocomotiveLog) -> Iterator[pd.DataFrame]:
    """The rows of the log in SI units, a part of them at a time."""
    # One for each, so that the rows do not depend on how many are drawn at a time.
    of_adhesion, of_wheel = (np.random.default_rng((log.seed, stream)) for stream in (1, 2))
    kept = np.zeros(1)  # what the AR(1) filter remembers
    slips = np.linspace(0.0, _slip_opt(log.curve), 2000)
    for begin in range(0, log.rows, _ROWS):
        time = STEP_S * np.arange(begin, min(begin + _ROWS, log.rows))
        speed, wanted = (np.interp(time, log.corners[0], line) for line in log.corners[1:])
        micro = np.interp(np.abs(wanted), burckhardt(log.curve, slips), slips)
        slip, event = np.sign(wanted) * micro, np.zeros(time.size, dtype=bool)
        for start, length, top in log.events:
            inside = (time - start) / length
            within = (inside > 0) & (inside < 1)
            slip[within] += top * np.sin(np.pi * inside[within]) ** 2
            event |= within
        day = 2 * np.pi * time / 3600
        humidity = 68 + 14 * np.sin(day / 7 + log.waves[0]) + 3 * np.sin(day / 1.3 + log.waves[1])
        load = _AXLE_LOAD_N + 800 * np.sin(11 * day + log.waves[2])
        columns = {"vehicle_speed_mps": speed, "relative_humidity_pct": humidity}
        course = LogCourse(slip, event, columns)
        adhesion = burckhardt(log.curve, slip)
        for strength, factor in (EFFECTS[name] for name in log.effects):
            adhesion = adhesion * factor(strength, course)
        white = SIGMA * np.sqrt(1 - AUTOCORRELATION**2) * of_adhesion.standard_normal(time.size)
        noise, kept = lfilter([1.0], [1.0, -AUTOCORRELATION], white, zi=kept)
        wheel = WHEEL_SPEED_NOISE_MPS * of_wheel.standard_normal(time.size)
        yield pd.DataFrame(
            {
                "time_s": time,
                "vehicle_speed_mps": speed,
                # A wheel that stands sends no pulses, and so no noise.
                "wheel_speed_mps": np.where(speed > 0, np.abs(speed * (1 + slip) + wheel), 0.0),
                "tangential_force_N": (adhesion + noise) * load,
                "normal_load_N": load,
                "relative_humidity_pct": humidity,
                "temperature_C": 9 + 6 * np.sin(day / 9 + log.waves[3]),
            }
        )


def write_csv(path: Path, log: LocomotiveLog) -> Iterator[int]:
    """The log as a German spreadsheet exports it; yields the number of rows of each part.

    Semicolons, decimal commas, km/h and kN, date and time of day, and bytes of cp1252.
    """
    with path.open("wb") as stream:
        stream.write(f"{';'.join(['Zeit', *_EXPORT])}\r\n".encode("cp1252"))
        for table in tables(log):
            stream.write(_lines(_exported(table)))
            yield len(table)


def write_parquet(path: Path, log: LocomotiveLog) -> Iterator[int]:
    """The same columns as numbers and stamps; yields the number of rows of each part."""
    parts = (
        pyarrow.Table.from_pandas(_exported(table), preserve_index=False) for table in tables(log)
    )
    first = next(parts)
    with pyarrow.parquet.ParquetWriter(path, first.schema) as writer:
        writer.write_table(first)
        yield first.num_rows
        for part in parts:
            writer.write_table(part)
            yield part.num_rows


def truth_text(log: LocomotiveLog) -> str:
    """What is behind the log, as JSON; with effects the peak is that of the curve before them."""
    slip = _slip_opt(log.curve)
    before = "_without_effects" if log.effects else ""
    events = [
        {"start_s": begin, "end_s": begin + length, "slip_above_micro_slip": top}
        for begin, length, top in np.round(log.events, 3).tolist()
    ]
    content = {
        "curve": {name: float(getattr(log.curve, name)) for name in ("c1", "c2", "c3")},
        f"slip_opt{before}": slip,
        f"mu_max{before}": float(burckhardt(log.curve, np.array(slip))),
        "events": events,
        "effects": {name: EFFECTS[name][0] for name in log.effects},
        "noise": {
            "wheel_speed_mps": WHEEL_SPEED_NOISE_MPS,
            "adhesion": SIGMA,
            "autocorrelation": AUTOCORRELATION,
        },
        "seed": log.seed,
    }
    return f"{json.dumps(content, indent=2)}\n"


def _slip_opt(curve: Burckhardt) -> float:
    """Where c1 c2 exp(-c2 s) = c3."""
    return float(np.log(curve.c1 * curve.c2 / curve.c3) / curve.c2)


def _trips(seconds: float, chance: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Corners of time, speed and adhesion, and the times [rooms, 2] in which an event fits."""
    corners = [(0.0, 0.0, 0.0)]
    rooms = []
    while corners[-1][0] < seconds:
        time = corners[-1][0] + chance.uniform(40.0, 150.0)  # at the platform
        top, gain = chance.uniform(17.0, 28.0), chance.uniform(0.25, 0.4)
        pull, brake = chance.uniform(0.12, 0.2), chance.uniform(0.3, 0.5)
        corners += [(time, 0.0, 0.0), (time + 2.0, gain * 2.0, pull)]
        rooms.append((time + 3.0 / gain, time + 16.0 / gain))
        time += top / gain
        corners += [(time, top, 0.6 * pull)]
        for _ in range(chance.integers(2, 6)):  # pulling and rolling in turn
            cruise = chance.uniform(30.0, 120.0)
            top += chance.uniform(-1.5, 1.0)
            corners += [(time + 3.0, top, chance.choice([0.0, 0.3]) * pull)]
            time += cruise
            corners += [(time, top, corners[-1][2])]
        corners += [(time + 3.0, top - 3.0 * brake, -0.4 * pull)]
        time += top / brake
        corners += [(time - 2.0, 2.0 * brake, -0.4 * pull), (time, 0.0, 0.0)]
    fitting = [room for room in rooms if room[1] < seconds]
    return np.array(corners).T, np.array(fitting).reshape(-1, 2)


def _exported(table: pd.DataFrame) -> pd.DataFrame:
    stamps = _BEGIN + np.round(1000 * table["time_s"].to_numpy()).astype("timedelta64[ms]")
    rounded = {
        name: (table[column] / unit).round(digits)
        for name, (column, unit, digits) in _EXPORT.items()
    }
    return pd.DataFrame({"Zeit": stamps, **rounded})


def _lines(table: pd.DataFrame) -> bytes:
    compute = pyarrow.compute
    stamps = compute.strftime(pyarrow.array(table["Zeit"]), format="%d.%m.%Y %H:%M:%S")
    cells = [compute.utf8_replace_slice(stamps, 19, 20, ",")]
    for name, (_, _, digits) in _EXPORT.items():
        number = pyarrow.array(table[name].to_numpy()).cast(pyarrow.decimal128(12, digits))
        cells.append(compute.replace_substring(number.cast(pyarrow.string()), ".", ","))
    rows = compute.binary_join_element_wise(*cells, ";")
    whole = compute.binary_join(pyarrow.ListArray.from_arrays([0, len(rows)], rows), "\r\n")
    text: str = whole[0].as_py()
    return f"{text}\r\n".encode("cp1252")
