"""The rows of a log that are used: fewer with each step, and each step says which and why."""

from collections import Counter
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from adhesion_jax.data.columns import COLUMNS, LABELS, MODES
from adhesion_jax.data.speeds import (
    ACCELERATION,
    LONGEST_HELD_S,
    between_updates,
    dropouts,
    held_for,
)
from adhesion_jax.data.stretches import (
    GAP_S,
    going_on,
    longest_step,
    series_of,
    stretches,
    usual_step,
)
from adhesion_jax.data.understanding import Taken
from adhesion_jax.errors import InputError
from adhesion_jax.wording import listed, number, percent

#: The largest share of the values of a column that may be none. Beyond it a column of numbers has
#: another unit or sign than was thought, and one with so much text holds labels; and the largest
#: share of rows at which a clock may step back. By hand.
MOST = 0.2

#: The size that nine rows in ten do not exceed is that of the data; what exceeds it this many
#: times, and the range of its quantity too, is no part of them. By hand.
_NINE_IN_TEN, _BEYOND = 0.9, 5.0
_BY_THE_DATA = ("slip_ratio", "adhesion")

#: A wheel whose load is below this share of that size is lifted.
_LIFTED = 0.01
_LOADS = ("normal_load_N", "axle_load_N", "locomotive_load_N")

#: What tells how a wheel turns.
_WHEELS = ("wheel_speed_mps", "wheel_rotation_radps")

#: A leap exceeds the usual step from row to row this many times. By hand.
_LEAP = 20.0

#: Rows from which that size is told: to order all of a long log takes seconds.
_SAMPLE = 200_000


@dataclass
class Rows:
    """The columns of a log by the names they are taken as, [rows], and what is said of them.

    They are changed in place, for two copies of the columns of a long log do not fit in memory.
    """

    numbers: dict[str, np.ndarray]  # NaN where a cell is empty
    labels: Mapping[str, pd.Categorical]
    index: pd.Index  # the numbers that a user sees of the rows
    texts: Mapping[str, tuple[int, str]]  # cells of text among numbers: how many, and the first
    left_out: dict[str, str]  # columns that are not used, each with the clause why
    origin: str  # from when a time counts that was given by dates, empty otherwise
    computed: dict[str, str] = field(default_factory=dict)  # columns that were, and what from
    notes: list[str] = field(default_factory=list)

    @property
    def count(self) -> int:
        return len(self.index)

    @property
    def series(self) -> np.ndarray:
        """A number for each run and axle, [rows]."""
        return series_of(self.labels, self.count)

    def keep(self, rows: np.ndarray) -> None:
        """Keeps some of the rows, [rows], bool."""
        if rows.all():
            return
        for name in self.numbers:
            self.numbers[name] = self.numbers[name][rows]
        self.labels = {name: of[rows] for name, of in self.labels.items()}
        self.index = self.index[rows]

    def tell(
        self, unused: np.ndarray, why: str, values: np.ndarray | None = None, unit: str = ""
    ) -> None:
        """Says of how many rows, [rows], bool, are not used, if any; `why` goes on from "in which".

        With the number of the first row, where `values` are given, and its value.
        """
        count = int(unused.sum())
        if not count:
            return
        words = "is 1 row" if count == 1 else f"are {count:,} rows"
        share = f"{unused.size:,} ({100 * unused.mean():.3g} %)"
        if values is not None:
            place = int(unused.argmax())
            value = number(float(values[place]))
            why = f"{why}; the first is row {self.index[place]}, with {value}{unit}"
        self.notes.append(f"Not used {words} of {share}, in which {why}.")

    def leave(
        self, unused: np.ndarray, why: str, values: np.ndarray | None = None, unit: str = ""
    ) -> None:
        """Leaves out rows, and says so (`tell`)."""
        self.tell(unused, why, values, unit)
        self.keep(~unused)

    def set_aside(self, taken: Mapping[str, Taken], needed: Set[str]) -> None:
        """Makes values that cannot be NaN, and leaves out columns of which most cannot.

        An infinite value is none. Text in a column of numbers, and a value out of the range of its
        quantity, is none where few are, at most MOST of all. Where more are, a column that is not
        needed is left out, and InputError tells all that is wrong with those that are. `taken` says
        in which column of the file a quantity was found, and each of several repeats is a column.
        """
        notes: list[str] = []
        faults: list[str] = []
        for name, source in taken.items():
            values = self.numbers[name]
            infinite, outside = np.isinf(values), np.zeros(values.size, bool)
            if source.quantity in COLUMNS:
                outside = _outside(values, source.quantity)
            found = []
            if name in self.texts:
                count, said = self.texts[name]
                found.append((count, "text", said))
            if outside.any():
                place = int(outside.argmax())
                said = _said(self.index[place], float(values[place]), source)
                found.append((int(outside.sum()), "out of range", said))
            written = int(np.count_nonzero(~np.isnan(values) & ~infinite))
            too_many = [said for count, _, said in found if count > MOST * (written + count)]
            if too_many and source.quantity in needed:
                faults += too_many
            elif too_many:
                self.left_out[name] = too_many[0]
                del self.numbers[name]
            else:
                if infinite.any():
                    said = f"row {self.index[int(infinite.argmax())]} of column {source.column}"
                    found.append((int(infinite.sum()), "infinite", said))
                for count, what, said in found:
                    some = "1 value is" if count == 1 else f"{count:,} values are"
                    others = "" if count == 1 else ", and others"
                    notes.append(f"{some} {what} and not used: {said}{others}.")
                if infinite.any() or outside.any():
                    self.numbers[name] = np.where(infinite | outside, np.nan, values)
        if faults:
            raise InputError("; ".join(dict.fromkeys(faults)))
        self.notes += dict.fromkeys(notes)

    def in_time(self, column: str) -> None:
        """Makes time go on within each run and axle where the clock stepped back.

        InputError where it steps back all the time, or most rows would be lost.
        """
        self.labels = _within_files(self.labels, self.numbers.get("time_s"))
        if "time_s" not in self.numbers:
            return
        time = self.numbers["time_s"]
        timed = ~np.isnan(time)
        where = slice(None) if timed.all() else timed  # of all rows a view, which takes no memory
        moved, of_those, parted = going_on(time[where], self.series[where])
        lost, cuts = np.zeros((2, time.size), bool)
        lost[where], cuts[where] = ~of_those, parted
        count, first = int(cuts.sum()), self.index[int((lost | cuts).argmax())]
        if int(lost.sum()) + count > MOST * np.count_nonzero(timed):
            raise InputError(
                f"column {column} decreases all the time, first in row {first} (sort each run by "
                "time, and number the runs in a column run)"
            )
        time[where] = moved
        first = self.index[int(lost.argmax())]
        back = "the clock steps back, until it shows again what it showed before; the first is row"
        self.tell(lost, f"{back} {first}")
        if count:
            others = f" and {count - 1:,} other rows" if count > 1 else ""
            self.notes.append(
                f"The time of column {column} begins anew in row {self.index[int(cuts.argmax())]}"
                f"{others}: the log is cut there, and the times from there on are moved behind "
                "those before."
            )
        self.keep(~lost)

    def labelled(self) -> None:
        """Keeps the rows that have a run, an axle and so on where there is such a column."""
        for name in LABELS:
            if name != "mode" and name in self.labels:
                self.leave(np.asarray(self.labels[name] == ""), f"the {name} is not named")
        modes = self.labels["mode"].categories if "mode" in self.labels else ()
        strange = [one for one in modes if one.lower() not in {"", *MODES}]
        if strange:
            own = {"mode": "mode (as it is)"}
            self.labels = {own.get(name, name): of for name, of in self.labels.items()}
            self.notes.append(
                f"The column mode keeps its labels, which are none of {listed([*MODES])}: "
                f"{listed(strange[:3])}."
            )

    def bridged(self, needed: Sequence[str]) -> None:
        """Fills short gaps of columns that are not needed.

        A gap is short if the values before and after it, of one run and axle and without a gap in
        time, are at most a second apart: a straight line between them is taken. Of a column of
        whole numbers, which may be states, it is only taken where both are the same.
        """
        time, kept = self.numbers.get("time_s"), {*needed, "time_s"}
        holed = [n for n, of in self.numbers.items() if n not in kept and np.isnan(of).any()]
        if time is None or not holed:
            return
        filled = dict.fromkeys(holed, 0)
        timed = np.flatnonzero(~np.isnan(time))
        for part in stretches(time[timed], self.series[timed]):
            at = time[timed[part]]
            for name in holed:
                values = self.numbers[name][timed[part]]
                there = ~np.isnan(values)
                known, held = at[there], values[there]
                after = np.searchsorted(known, at)
                hole = np.flatnonzero(~there & (after > 0) & (after < known.size))
                if not hole.size:
                    continue
                after = after[hole]
                short = known[after] - known[after - 1] < 1.001 * GAP_S
                if (held % 1 == 0).all():
                    short &= held[after] == held[after - 1]
                values[hole[short]] = np.interp(at[hole[short]], known, held)
                self.numbers[name][timed[part]] = values
                filled[name] += int(short.sum())
        self.notes += [
            f"In {rows:,} of {time.size:,} rows there is no value of {name}: it is taken from a "
            f"straight line between its neighbours, at most {GAP_S:g} s apart."
            for name, rows in filled.items()
            if rows
        ]

    def without_gaps(self, needed: Sequence[str], few: float) -> None:
        """Keeps the rows that have a value, not NaN, in every column that is kept.

        A row must have one in the columns that are needed. Of the others, those with the fewest
        gaps come first: as long as all that are kept cost at most the share `few` of the rows, the
        rows are left out, and then the column. Blank rows at the end are no rows, and not counted.
        InputError where no row is kept.
        """
        missing = {name: np.isnan(values) for name, values in self.numbers.items()}
        written = np.flatnonzero(~np.logical_and.reduce([*missing.values()]))
        rows = slice(written[-1] + 1 if written.size else 0)
        kept = ~np.logical_or.reduce([missing[name] for name in needed])
        holes = [name for name in needed if missing[name][rows].any()]
        if holes:
            self.tell(~kept[rows], f"there is no value of {listed(holes, 'or')}")
        further = sorted({*missing} - {*needed}, key=lambda one: (missing[one].sum(), one))
        allowed = (1 - few) * np.count_nonzero(kept)
        for name in further:
            lost = kept & missing[name]
            if np.count_nonzero(kept & ~lost) >= allowed:
                self.tell(lost[rows], f"there is no value of {name}")
                kept &= ~lost
            else:
                gaps = f"{100 * missing[name][rows].mean():.3g} % of its rows have no value"
                self.left_out[name] = f"{gaps}, and at most {100 * few:.3g} % of all rows may"
                del self.numbers[name]
        if not kept.any():
            empty = [name for name in needed if missing[name].all()]
            raise InputError(f"no row has a value in {listed(empty or needed)}")
        self.keep(kept)

    def within(self) -> None:
        """Keeps the rows whose computed values are not beyond what the others show."""
        for name in self.computed:
            values = self.numbers[name]
            wrong = ~np.isfinite(values) | _outside(values, name)
            self.leave(wrong, f"{name} comes out beyond what it is in the others", values)

    def updated(self) -> None:
        """Puts a train speed that is held over several rows on straight lines."""
        wheels = [self.numbers[name] for name in _WHEELS if name in self.numbers]
        if not wheels or not {"vehicle_speed_mps", "time_s"} <= {*self.numbers}:
            return
        speed, time = self.numbers["vehicle_speed_mps"], self.numbers["time_s"]
        held, step = held_for(speed, wheels[0], self.series), usual_step(time, self.series)
        if 0 < held * step <= LONGEST_HELD_S:
            speed, known = between_updates(speed, time, self.series, held)
            self.numbers["vehicle_speed_mps"] = speed
            self.notes.append(
                f"The train speed changes every {number(held * step)} s, "
                "and that of the wheel in the rows between too: a straight line is taken between "
                "the rows in which the train speed is told."
            )
            self.leave(~known, "the train speed is not told again before a gap or the end")

    def without_leaps(self) -> None:
        """Keeps the rows in which the speed of the wheel does not leap for one row."""
        if {"slip_velocity_mps", "vehicle_speed_mps", "time_s"} <= {*self.numbers}:
            slip, speed = self.numbers["slip_velocity_mps"], self.numbers["vehicle_speed_mps"]
            self.leave(
                dropouts(slip, speed, self.numbers["time_s"], self.series),
                "the wheel stands and turns again sooner than a wheel can be braked, as where its "
                "signal drops out",
                slip,
                " m/s",
            )
        if {"slip_velocity_mps", "time_s"} <= {*self.numbers}:
            slip = self.numbers["slip_velocity_mps"]
            self.leave(
                leaps(slip, self.numbers["time_s"], self.series),
                "the slip velocity leaps, for this row alone, further than a wheel can be "
                "accelerated",
                slip,
                " m/s",
            )


def leaps(slip_mps: np.ndarray, time_s: np.ndarray, series: np.ndarray) -> np.ndarray:
    """Which rows, [rows], bool, have a slip velocity that no wheel reaches and leaves in one row.

    It lies beyond those of both neighbours of its series (or of the one that the first and the last
    row have), further from zero by more than a wheel can be accelerated, than the size that nine
    rows in ten do not exceed, and than 20 usual steps: as where a tooth of the encoder is counted
    twice.
    """
    steps, within = np.diff(slip_mps), np.diff(series) == 0
    usual = float(np.median(np.abs(_some(steps)))) if steps.size else 0.0
    least = max(_nine_in_ten(slip_mps), _LEAP * usual)
    far = within & (np.abs(steps) > np.maximum(least, ACCELERATION * np.diff(time_s)))
    up = np.where(far, np.sign(steps), 0.0)
    here, there = np.append(0.0, up), np.append(-up, 0.0)  # by how it differs from either side
    first, last = np.append(True, ~within), np.append(~within, True)
    return np.asarray(((here * there > 0) | first | last) & ((here + there) * slip_mps > 0))


def _some(values: np.ndarray) -> np.ndarray:
    """The finite ones of evenly chosen values."""
    some: np.ndarray = values[:: max(1, values.size // _SAMPLE)]
    return some[np.isfinite(some)]


def _nine_in_ten(values: np.ndarray) -> float:
    """The size that nine values in ten do not exceed; 0 without any."""
    some = _some(values)
    return float(np.quantile(np.abs(some), _NINE_IN_TEN)) if some.size else 0.0


def _outside(values: np.ndarray, quantity: str) -> np.ndarray:
    lower, upper = COLUMNS[quantity].lower, COLUMNS[quantity].upper
    if quantity in (*_BY_THE_DATA, *_LOADS):
        size = _nine_in_ten(values)
        if quantity in _LOADS:
            lower = max(lower, _LIFTED * size)
        else:
            lower, upper = min(lower, -_BEYOND * size), max(upper, _BEYOND * size)
    return np.asarray(np.isfinite(values) & ((values < lower) | (values > upper)))


def _said(row: int, value: float, source: Taken) -> str:
    """A value that cannot be, as a clause."""
    column = COLUMNS[source.quantity]
    unit = "" if column.unit == "1" else f" {column.unit}"
    to = source.conversion
    written = "" if to == (1.0, 0.0) else f" ({to.back(value):g} {source.unit})"
    where = f"row {row} of column {source.column} has {value:.6g}{unit}{written}"
    if source.quantity in _LOADS:
        return f"{where}, under {percent(_LIFTED)} of the usual load ({column.advice})"
    return f"{where}, outside {column.span} ({column.advice})"


def _within_files(
    labels: Mapping[str, pd.Categorical], time: np.ndarray | None
) -> Mapping[str, pd.Categorical]:
    """The labels, where a run reaches over two files only if its time goes on without a gap.

    One that is named in several files and does not go on is file:run.
    """
    if not {"run", "file"} <= {*labels}:
        return labels
    run, file = labels["run"], labels["file"]
    width = len(run.categories)
    part, both = pd.factorize(file.codes.astype(np.int64) * width + run.codes)
    runs = (both % width).tolist()
    times = np.full(part.size, np.nan) if time is None else time
    spans = pd.Series(times).groupby(part).agg(["min", "max"]).to_numpy()
    longest = longest_step(times, part)
    # The first part of the run that each part goes on, itself if it begins one.
    first, before = np.arange(both.size), dict.fromkeys(runs, -1)
    for one, of_run in enumerate(runs):
        last, before[of_run] = before[of_run], one
        if last >= 0 and 0 <= spans[one, 0] - spans[last, 1] <= longest:
            first[one] = first[last]
    begun = Counter(runs[one] for one in {*first.tolist()})
    names = []
    for begin, of_run in zip(first.tolist(), runs, strict=True):
        name = run.categories[of_run]
        several = name and begun[of_run] > 1
        names.append(f"{file.categories[both[begin] // width]}:{name}" if several else name)
    found, of_names = pd.factorize(np.array(names, dtype=object))
    own = pd.Categorical.from_codes(found[part], pd.Index(of_names, dtype="str"))
    return {**labels, "run": own}
