"""Slip events cut out of a whole log: the seconds in which a wheel leaves its micro-slip."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import scipy

from adhesion_jax.data.reading import Measured
from adhesion_jax.data.stretches import GAP_S, GAP_STEPS
from adhesion_jax.errors import InputError
from adhesion_jax.wording import listed, percent

#: Fewest rows of a table whose events are cut out without being asked for.
LONG = 10_000

#: Largest share of a log that its events may cover: beyond it the wheel slips most of the time.
MOST = 0.5

#: Slip is averaged over this time before it is compared, so that the noise of samples counts less.
WINDOW_S = 0.2

#: An event begins where the averaged slip, less its median, exceeds this multiple of its noise ...
NOISES = 6.0

#: ... and this size, below which a wheel creeps but does not slip, by the name of the slip ...
LEAST = {"slip_ratio": 0.01, "slip_velocity_mps": 0.05}

#: ... for this time and this number of rows.
HOLD_S, HOLD_ROWS = 0.3, 3

#: It ends where the averaged slip has returned. This time before and after belongs to the event,
#: because the curve rises there; events that are closer than twice this time are one.
LEAD_S = 2.0

#: Time over which the change of slip tells its noise.
LAG_S = 1.0

#: Largest number of rows from which a median is taken, or that are compared at a time, and number
#: of classes of speed.
_SAMPLE, _CLASSES = 400_000, 16

#: Number of equal times of the overview.
_PLACES = 2000

#: The standard deviation of a normal variable over the median of its size.
_NORMAL = 1.4826


class SlipNoise(NamedTuple):
    """The averaged slip of a log between its events: micro-slip and noise.

    Its standard deviation is sqrt(constant^2 + (by_speed/v)^2), v the speed of the vehicle: a noise
    of the wheel speed makes a noise of slip that grows as the speed falls.
    """

    median: float  # not 0 where the radius of the wheel is not quite right
    constant: float  # in the unit of slip
    by_speed: float  # m/s; 0 without a speed of the vehicle

    def deviation(self, speed: np.ndarray) -> np.ndarray:
        return np.sqrt(self.constant**2 + (self.by_speed / speed) ** 2)


class Events(NamedTuple):
    """The slip events of a log; the log itself is not held."""

    #: A row an event: its number (run), start_s, end_s, duration_s, traction or braking (mode),
    #: largest_slip and largest_adhesion (averaged, with their sign), and the number of its rows.
    table: pd.DataFrame
    rows: int  # of the log
    slip: str  # the column that is the slip
    noise: SlipNoise
    #: The log in equal times: start_s, end_s, and the smallest and largest averaged slip and speed
    #: in them (slip_low, slip_high, speed_low, speed_high), NaN where there is none.
    overview: pd.DataFrame

    @property
    def share(self) -> float:
        """Share of the rows of the log that lies in events."""
        return float(self.table["rows"].sum()) / self.rows


class Chosen(NamedTuple):
    """The rows of a table that are used."""

    points: Measured
    events: Events | None  # None where all rows are used
    sentence: str  # what is used, and why; empty for a table that nobody would take for a log


class _Averaged(NamedTuple):
    """A log in stretches without a gap; arrays [rows]."""

    time: np.ndarray
    speed: np.ndarray | None
    slip: np.ndarray  # averaged over the window
    first: np.ndarray  # [stretches] first row
    stop: np.ndarray  # [stretches] the row after the last
    window: int  # rows
    hold: int  # rows
    lag: int  # rows


def events_of(
    tables: Sequence[Measured], wanted: bool | None = None, fewest: int = LONG
) -> list[Chosen]:
    """Of each table the rows of slip events alone, numbered in the column `run`, or all rows.

    With `wanted` None the events are cut out of a table of at least `fewest` rows with time_s
    and without a column run, unless the wheel slips most of the time: where events would cover more
    than MOST of the rows, or the usual noise of slip exceeds LEAST. With `wanted` False all rows
    are used.

    An event begins where the slip, averaged over WINDOW_S and less its median, exceeds NOISES times
    its noise (`SlipNoise`, robust, from the log itself) and LEAST, for HOLD_S. It ends where that
    slip has returned, or at a gap in time. LEAD_S before and after belong to it, and events that
    overlap with these are one.

    A log without an event is not used where another table is. InputError where there is no other,
    and where events are wanted of a table that is no log.
    """
    found = []
    for table in tables:
        cut = wanted or (wanted is None and len(table.table) >= fewest)
        parts = _by_axle(table) if cut else [table]
        found += [_chosen(part, wanted, fewest // len(parts)) for part in parts]
    used = [one for one in found if len(one.points.table)]
    if not used:
        raise InputError(found[0].sentence)
    idle = [_short(one.points) for one in found if not len(one.points.table)]
    if idle:
        unused = f"{listed(idle)} {'has' if len(idle) == 1 else 'have'} no slip event: not used."
        used[0] = used[0]._replace(sentence=f"{used[0].sentence} {unused}".strip())
    return used


def _by_axle(measured: Measured) -> list[Measured]:
    """A log of several axles as a log of each, for each slips at times of its own."""
    table = measured.table
    if "run" in table or not {"axle", "time_s"} <= {*table}:
        return [measured]
    of_axle = table.groupby("axle", observed=True, sort=False)
    if of_axle.ngroups == 1:
        return [measured]
    return [
        measured._replace(name=f"{measured.name}, axle {axle}", table=rows)
        for axle, rows in of_axle
    ]


def _chosen(measured: Measured, wanted: bool | None, fewest: int) -> Chosen:
    """The rows of one table; where a log has no event there are none, and it is said why."""
    table = measured.table
    lacking = ""
    if "run" in table:
        lacking = "has a column run, and its runs are taken as they are"
    elif "time_s" not in table:
        lacking = "has no column time_s"
    if wanted and lacking:
        raise InputError(
            f"No slip events are cut out of {measured.name}: it {lacking}; leave out --events."
        )
    if wanted is False or lacking or (wanted is None and len(table) < fewest):
        return Chosen(measured, None, _all(table, "as asked for") if wanted is False else "")
    least = LEAST[measured.slip]
    log = _averaged(measured)
    noise = _noise(log)
    first, stop = _spans(log, noise, least)
    if wanted is None:
        share = float(np.sum(stop - first)) / len(table)
        usual = noise.constant  # the standard deviation of the averaged slip at the median speed
        if log.speed is not None:
            some = log.speed[:: _stride(log.speed.size)]
            usual = float(noise.deviation(np.median(some, keepdims=True))[0])
        if share > MOST or usual > least:
            many = f"{percent(share)} of them lie in slip events"
            why = many if share > MOST else f"slip scatters by {usual:.2g} all along"
            return Chosen(measured, None, _all(table, why))
    events = _events(measured, log, noise, first, stop)
    run = np.repeat(events.table["run"].to_numpy(), stop - first)
    rows = np.arange(run.size) + np.repeat(stop - np.cumsum(stop - first), stop - first)
    points = measured._replace(table=table.take(rows).assign(run=run))
    said = _cut(measured, events, log) if first.size else _no_event(measured, log, noise)
    return Chosen(points, events, said)


def _averaged(measured: Measured) -> _Averaged:
    table = measured.table
    time = table["time_s"].to_numpy(float)
    speed = None
    if measured.slip == "slip_ratio" and "vehicle_speed_mps" in table:
        speed = table["vehicle_speed_mps"].to_numpy(float)
    some = np.arange(0, time.size - 1, _stride(time.size))
    steps = time[some + 1] - time[some]
    step = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    # The first row after a gap; the steps themselves would take as much memory as the time.
    limit = max(GAP_STEPS * step, GAP_S)
    after_gap = np.concatenate([[0], 1 + np.flatnonzero(time[1:] > time[:-1] + limit)])
    first, stop = after_gap, np.append(after_gap[1:], time.size)
    slip = np.empty(time.size, dtype=np.float32)
    raw = table[measured.slip].to_numpy(float)

    def rows(seconds: float) -> int:
        return round(seconds / step) if step else 0

    window = 1 + 2 * rows(WINDOW_S / 2)
    for begin, end in zip(first, stop, strict=True):
        scipy.ndimage.uniform_filter1d(
            raw[begin:end], window, output=slip[begin:end], mode="nearest"
        )
    hold, lag = max(HOLD_ROWS, rows(HOLD_S)), max(1, rows(LAG_S))
    return _Averaged(time, speed, slip, first, stop, window, hold, lag)


def _stride(rows: int) -> int:
    return max(1, rows // _SAMPLE)


def _runs(flag: np.ndarray, breaks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First rows, and the rows after the last, of what is true without a break."""
    before, after = np.append(False, flag[:-1]), np.append(flag[1:], False)
    before[breaks] = False
    after[breaks[breaks > 0] - 1] = False
    return np.flatnonzero(flag & ~before), 1 + np.flatnonzero(flag & ~after)


def _noise(log: _Averaged) -> SlipNoise:
    """From medians, which a few events do not move.

    What depends on the speed is told by the change of slip over LAG_S, in which the micro-slip
    hardly changes: in classes of speed its squared scale is a straight line against 1/v^2, fitted
    by the median of slopes (Sen 1968, J. Am. Stat. Assoc. 63:1379-1389).
    """
    rows = np.arange(0, log.slip.size, _stride(log.slip.size))
    median = float(np.median(log.slip[rows]))
    constant = _NORMAL * float(np.median(np.abs(log.slip[rows] - median)))
    rows = rows[rows < log.slip.size - log.lag]
    if log.speed is None or not rows.size:
        return SlipNoise(median, constant, 0.0)
    change = np.abs(log.slip[rows + log.lag] - log.slip[rows])
    inverse = log.speed[rows] ** -2.0
    order = np.argsort(inverse, kind="stable")
    classes = np.array_split(order, min(_CLASSES, order.size))
    centre = np.array([np.median(inverse[one]) for one in classes])
    # The change is that of two averages.
    square = np.array([(_NORMAL * np.median(change[one])) ** 2 / 2 for one in classes])
    slope = float(scipy.stats.theilslopes(square, centre).slope) if np.ptp(centre) else 0.0
    return SlipNoise(median, constant, max(slope, 0.0) ** 0.5)


def _spans(log: _Averaged, noise: SlipNoise, least: float) -> tuple[np.ndarray, np.ndarray]:
    """First rows of the events, and the rows after their last."""
    level = np.empty(log.slip.size, dtype=np.float32)  # of the threshold
    for begin in range(0, level.size, _SAMPLE):
        part = slice(begin, begin + _SAMPLE)
        speed = np.ones(1) if log.speed is None else log.speed[part]
        threshold = np.maximum(NOISES * noise.deviation(speed), least)
        level[part] = np.abs(log.slip[part] - noise.median) / threshold
    first, stop = _runs(level > 1, log.first)
    held = stop - first >= log.hold
    first, stop = first[held], stop[held]
    stretch = np.searchsorted(log.first, first, "right") - 1
    early = np.searchsorted(log.time, log.time[first] - LEAD_S, "left")
    late = np.searchsorted(log.time, log.time[stop - 1] + LEAD_S, "right")
    first = np.maximum(early, log.first[stretch])
    stop = np.minimum(late, log.stop[stretch])
    apart = first[1:] >= stop[:-1]
    return first[np.append(True, apart)[: first.size]], stop[np.append(apart, True)[: stop.size]]


def _events(
    measured: Measured, log: _Averaged, noise: SlipNoise, first: np.ndarray, stop: np.ndarray
) -> Events:
    adhesion = measured.table["adhesion"].to_numpy(float)
    largest = np.empty((2, first.size))
    for number, rows in enumerate(map(slice, first, stop)):
        slip = log.slip[rows]
        level = scipy.ndimage.uniform_filter1d(adhesion[rows], log.window, mode="nearest")
        largest[0, number] = slip[np.argmax(np.abs(slip - noise.median))]
        largest[1, number] = level[np.argmax(np.abs(level))]
    start, end = log.time[first], log.time[stop - 1]
    columns = {
        "run": np.arange(1, first.size + 1).astype(str),
        "start_s": start,
        "end_s": end,
        "duration_s": end - start,
        "mode": np.where(largest[0] < noise.median, "braking", "traction"),
        "largest_slip": largest[0],
        "largest_adhesion": largest[1],
        "rows": stop - first,
    }
    return Events(pd.DataFrame(columns), log.time.size, measured.slip, noise, _overview(log))


def _overview(log: _Averaged) -> pd.DataFrame:
    edges = np.linspace(log.time[0], log.time[-1], _PLACES + 1)
    place = np.searchsorted(log.time, edges[:-1], "left")
    # Between two equal places reduceat takes one row where there is none.
    empty = np.append(np.diff(place), 1) == 0
    table = {"start_s": edges[:-1], "end_s": edges[1:]}
    for name, values in (("slip", log.slip), ("speed", log.speed)):
        for end, of in (("low", np.fmin), ("high", np.fmax)):
            there = None if values is None else of.reduceat(values, place)
            table[f"{name}_{end}"] = np.where(empty, np.nan, np.nan if there is None else there)
    return pd.DataFrame(table)


def _all(table: pd.DataFrame, why: str) -> str:
    return f"All {len(table):,} rows are used: {why}."


def _cut(measured: Measured, events: Events, log: _Averaged) -> str:
    count, rows = len(events.table), int(events.table["rows"].sum())
    braking = int((events.table["mode"] == "braking").sum())
    seconds = log.time[-1] - log.time[0]
    lasted = f"{seconds / 3600:.2g} h" if seconds >= 5400 else f"{seconds / 60:.2g} min"
    sides = f" ({count - braking} in traction, {braking} in braking)" if braking else ""
    return (
        f"{count} slip event{'s' if count > 1 else ''}{sides} cut out of {_short(measured)} "
        f"({lasted}) {'are runs' if count > 1 else 'is the run'}: {rows:,} of "
        f"{events.rows:,} rows with a slip are used ({percent(events.share)}). An event "
        f"begins where the slip exceeds {_threshold(events.noise, events.slip)}; the {LEAD_S:g} s "
        f"before and after it belong to it."
    )


def _threshold(noise: SlipNoise, slip: str) -> str:
    """The threshold in words that follow `exceeds`."""
    spread = f"{noise.constant:.2g}"
    if noise.by_speed:
        spread = f"sqrt({noise.constant:.2g}^2 + ({noise.by_speed:.2g} m/s / speed)^2)"
    unit = "" if slip == "slip_ratio" else " m/s"
    return (
        f"both {NOISES:g} times its usual scatter of {spread} and {LEAST[slip]:g}{unit} for "
        f"{HOLD_S:g} s (averaged over {WINDOW_S:g} s and less its median of {noise.median:.2g})"
    )


def _no_event(measured: Measured, log: _Averaged, noise: SlipNoise) -> str:
    """Why no curve can be learnt from a log that does not slip, and what to do."""
    unit = "" if measured.slip == "slip_ratio" else " m/s"
    size = np.abs(log.slip - noise.median)
    row = int(np.argmax(size))
    return (
        f"{measured.name} has no slip event: its slip nowhere exceeds "
        f"{_threshold(noise, measured.slip)}, and is {log.slip[row]:.2g}{unit} at most, at "
        f"{log.time[row]:.6g} s; give a log in which the wheel slips, or use all rows by --whole."
    )


def _short(measured: Measured) -> str:
    return Path(measured.name).name
