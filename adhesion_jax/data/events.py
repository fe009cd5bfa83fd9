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
    log = _Log(measured)
    if wanted is None and (why := log.slips_throughout):
        return Chosen(measured, None, _all(table, why))
    events, count = log.events, log.stop - log.start
    run = np.repeat(events.table["run"].to_numpy(), count)
    rows = np.arange(run.size) + np.repeat(log.stop - np.cumsum(count), count)
    points = measured._replace(table=table.take(rows).assign(run=run))
    return Chosen(points, events, log.cut(events) if run.size else log.no_event)


class _Log:
    """A log in stretches without a gap, and where its events are; arrays [rows]."""

    def __init__(self, measured: Measured) -> None:
        table = measured.table
        self.measured, self.name = measured, _short(measured)
        self.unit = "" if measured.slip == "slip_ratio" else " m/s"
        self.time = time = table["time_s"].to_numpy(float)
        self.speed = None
        if not self.unit and "vehicle_speed_mps" in table:
            self.speed = table["vehicle_speed_mps"].to_numpy(float)
        some = np.arange(0, time.size - 1, _stride(time.size))
        steps = time[some + 1] - time[some]
        step = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
        # The first row after a gap; the steps themselves would take as much memory as the time.
        limit = max(GAP_STEPS * step, GAP_S)
        self.edges = np.append(0, 1 + np.flatnonzero(time[1:] > time[:-1] + limit))

        def rows(seconds: float) -> int:
            return round(seconds / step) if step else 0

        self.window, self.lag = 1 + 2 * rows(WINDOW_S / 2), max(1, rows(LAG_S))
        self.slip = np.empty(time.size, dtype=np.float32)  # averaged over the window
        raw = table[measured.slip].to_numpy(float)
        for part in map(slice, self.edges, np.append(self.edges[1:], time.size)):
            scipy.ndimage.uniform_filter1d(
                raw[part], self.window, output=self.slip[part], mode="nearest"
            )
        self.noise = self._noise()
        #: First rows of the events, and the rows after their last.
        self.start, self.stop = self._spans(max(HOLD_ROWS, rows(HOLD_S)))

    def _noise(self) -> SlipNoise:
        """From medians, which a few events do not move.

        What depends on the speed is told by the change of slip over LAG_S, in which the micro-slip
        hardly changes: in classes of speed its squared scale is a straight line against 1/v^2,
        fitted by the median of slopes (Sen 1968, J. Am. Stat. Assoc. 63:1379-1389).
        """
        slip = self.slip
        rows = np.arange(0, slip.size, _stride(slip.size))
        median = float(np.median(slip[rows]))
        constant = _NORMAL * float(np.median(np.abs(slip[rows] - median)))
        rows = rows[rows < slip.size - self.lag]
        if self.speed is None or not rows.size:
            return SlipNoise(median, constant, 0.0)
        change = np.abs(slip[rows + self.lag] - slip[rows])
        inverse = self.speed[rows] ** -2.0
        order = np.argsort(inverse, kind="stable")
        classes = np.array_split(order, min(_CLASSES, order.size))
        centre = np.array([np.median(inverse[one]) for one in classes])
        # The change is that of two averages.
        square = np.array([(_NORMAL * np.median(change[one])) ** 2 / 2 for one in classes])
        slope = float(scipy.stats.theilslopes(square, centre).slope) if np.ptp(centre) else 0.0
        return SlipNoise(median, constant, max(slope, 0.0) ** 0.5)

    def _spans(self, hold: int) -> tuple[np.ndarray, np.ndarray]:
        """First rows of the events, and the rows after their last; they hold for so many rows."""
        above = np.empty(self.slip.size, dtype=bool)
        for begin in range(0, above.size, _SAMPLE):
            part = slice(begin, begin + _SAMPLE)
            speed = np.ones(1) if self.speed is None else self.speed[part]
            threshold = np.maximum(NOISES * self.noise.deviation(speed), LEAST[self.measured.slip])
            level = np.abs(self.slip[part] - self.noise.median) / threshold
            above[part] = level.astype(np.float32) > 1
        before, after = np.append(False, above[:-1]), np.append(above[1:], False)
        before[self.edges] = False
        after[self.edges[1:] - 1] = False
        start, stop = np.flatnonzero(above & ~before), 1 + np.flatnonzero(above & ~after)
        held = stop - start >= hold
        start, stop = start[held], stop[held]
        stretch = np.searchsorted(self.edges, start, "right")
        early = np.searchsorted(self.time, self.time[start] - LEAD_S, "left")
        late = np.searchsorted(self.time, self.time[stop - 1] + LEAD_S, "right")
        start = np.maximum(early, self.edges[stretch - 1])
        stop = np.minimum(late, np.append(self.edges, self.time.size)[stretch])
        apart = start[1:] >= stop[:-1]
        return (
            start[np.append(True, apart)[: start.size]],
            stop[np.append(apart, True)[: stop.size]],
        )

    @property
    def slips_throughout(self) -> str:
        """Why no events are cut out, as the wheel slips most of the time; empty where they are."""
        share = float(np.sum(self.stop - self.start)) / self.time.size
        usual = self.noise.constant  # the deviation of the averaged slip at the median speed
        if self.speed is not None:
            some = self.speed[:: _stride(self.speed.size)]
            usual = float(self.noise.deviation(np.median(some, keepdims=True))[0])
        if share > MOST:
            return f"{percent(share)} of them lie in slip events"
        if usual > LEAST[self.measured.slip]:
            return f"slip scatters by {usual:.2g} all along"
        return ""

    @property
    def events(self) -> Events:
        adhesion = self.measured.table["adhesion"].to_numpy(float)
        largest = np.empty((2, self.start.size))
        for number, rows in enumerate(map(slice, self.start, self.stop)):
            inside = self.slip[rows]
            level = scipy.ndimage.uniform_filter1d(adhesion[rows], self.window, mode="nearest")
            largest[0, number] = inside[np.argmax(np.abs(inside - self.noise.median))]
            largest[1, number] = level[np.argmax(np.abs(level))]
        begin, end = self.time[self.start], self.time[self.stop - 1]
        columns = {
            "run": np.arange(1, begin.size + 1).astype(str),
            "start_s": begin,
            "end_s": end,
            "duration_s": end - begin,
            "mode": np.where(largest[0] < self.noise.median, "braking", "traction"),
            "largest_slip": largest[0],
            "largest_adhesion": largest[1],
            "rows": self.stop - self.start,
        }
        table, slip = pd.DataFrame(columns), self.measured.slip
        return Events(table, self.time.size, slip, self.noise, self._overview)

    @property
    def _overview(self) -> pd.DataFrame:
        edges = np.linspace(self.time[0], self.time[-1], _PLACES + 1)
        place = np.searchsorted(self.time, edges[:-1], "left")
        # Between two equal places reduceat takes one row where there is none.
        empty = np.append(np.diff(place), 1) == 0
        table = {"start_s": edges[:-1], "end_s": edges[1:]}
        for name, values in (("slip", self.slip), ("speed", self.speed)):
            for end, of in (("low", np.fmin), ("high", np.fmax)):
                there = np.nan if values is None else of.reduceat(values, place)
                table[f"{name}_{end}"] = np.where(empty, np.nan, there)
        return pd.DataFrame(table)

    def cut(self, events: Events) -> str:
        """How many events were cut out, and by which threshold."""
        count, rows = len(events.table), int(events.table["rows"].sum())
        braking = int((events.table["mode"] == "braking").sum())
        seconds = self.time[-1] - self.time[0]
        lasted = f"{seconds / 3600:.2g} h" if seconds >= 5400 else f"{seconds / 60:.2g} min"
        sides = f" ({count - braking} in traction, {braking} in braking)" if braking else ""
        return (
            f"{count} slip event{'s' if count > 1 else ''}{sides} cut out of {self.name} "
            f"({lasted}) {'are runs' if count > 1 else 'is the run'}: {rows:,} of "
            f"{events.rows:,} rows with a slip are used ({percent(events.share)}). An event "
            f"begins where the slip exceeds {self._threshold}; the {LEAD_S:g} s before and after "
            "it belong to it."
        )

    @property
    def no_event(self) -> str:
        """Why no curve can be learnt from a log that does not slip, and what to do."""
        row = int(np.argmax(np.abs(self.slip - self.noise.median)))
        return (
            f"{self.measured.name} has no slip event: its slip nowhere exceeds {self._threshold}, "
            f"and is {self.slip[row]:.2g}{self.unit} at most, at {self.time[row]:.6g} s; give a "
            "log in which the wheel slips, or use all rows by --whole."
        )

    @property
    def _threshold(self) -> str:
        """The threshold in words that follow `exceeds`."""
        noise, least = self.noise, LEAST[self.measured.slip]
        spread = f"{noise.constant:.2g}"
        if noise.by_speed:
            spread = f"sqrt({noise.constant:.2g}^2 + ({noise.by_speed:.2g} m/s / speed)^2)"
        return (
            f"both {NOISES:g} times its usual scatter of {spread} and {least:g}{self.unit} for "
            f"{HOLD_S:g} s (averaged over {WINDOW_S:g} s and less its median of {noise.median:.2g})"
        )


def _stride(rows: int) -> int:
    return max(1, rows // _SAMPLE)


def _all(table: pd.DataFrame, why: str) -> str:
    return f"All {len(table):,} rows are used: {why}."


def _short(measured: Measured) -> str:
    return Path(measured.name).name
