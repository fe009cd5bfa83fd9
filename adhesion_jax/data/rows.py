"""The rows of a log that are used: fewer with each step, and each step says which and why."""

from collections.abc import Iterable, Mapping, Set

import numpy as np
import pandas as pd

from adhesion_jax.data.columns import COLUMNS, LABELS, MODES
from adhesion_jax.data.gathering import MOST, Gathered
from adhesion_jax.data.stretches import longest_step, of_rows, series_of, with_clock
from adhesion_jax.data.understanding import Taken
from adhesion_jax.errors import InputError
from adhesion_jax.wording import listed, number, percent

#: The size that nine rows in ten do not exceed is that of the data; what exceeds it this many
#: times, and the range of its quantity too, is no part of them. By hand.
_NINE_IN_TEN, _BEYOND = 0.9, 5.0
_BY_THE_DATA = ("slip_ratio", "adhesion")

#: A wheel whose load is below this share of that size is lifted.
_LIFTED = 0.01
_LOADS = ("normal_load_N", "axle_load_N", "locomotive_load_N")

#: No wheel gains or loses speed faster, in m/s^2: 70 kN turn a wheelset of 420 kg m2 with 60.
_ACCELERATION = 60.0

#: A leap exceeds the usual step from row to row this many times. By hand.
_LEAP = 20.0

#: Rows from which that size is told: to order all of a long log takes seconds.
_SAMPLE = 200_000


def set_aside(
    read: Gathered, taken: Mapping[str, Taken], needed: Set[str], first_row: int
) -> tuple[list[str], dict[str, str]]:
    """Makes values that cannot be NaN, in place; sentences, and the columns that are left out.

    An infinite value is none. Text in a column of numbers, and a value out of the range of its
    quantity, is none where few are, at most MOST of all. Where more are, a column that is not
    needed is left out, and InputError tells all that is wrong with those that are. `taken` says
    in which column of the file a quantity was found, and each of several repeats is a column.
    """
    notes: list[str] = []
    faults: list[str] = []
    left_out: dict[str, str] = {}
    for name, source in taken.items():
        values = read.numbers[name]
        infinite, outside = np.isinf(values), np.zeros(values.size, bool)
        if source.quantity in COLUMNS:
            outside = _outside(values, source.quantity)
        found = []
        if name in read.texts:
            count, said = read.texts[name]
            found.append((count, "text", said))
        if outside.any():
            said = _said(values, outside, source, first_row)
            found.append((int(outside.sum()), "out of range", said))
        written = int(np.count_nonzero(~np.isnan(values) & ~infinite))
        too_many = [(count, said) for count, _, said in found if count > MOST * (written + count)]
        if too_many and source.quantity in needed:
            faults += [said for _, said in too_many]
        elif too_many:
            left_out[name] = too_many[0][1]
            del read.numbers[name]
        else:
            if infinite.any():
                row = first_row + int(infinite.argmax())
                said = f"row {row} of column {source.column}"
                found.append((int(infinite.sum()), "infinite", said))
            for count, what, said in found:
                if count == 1:
                    notes.append(f"1 value is {what} and not used: {said}.")
                else:
                    notes.append(f"{count:,} values are {what} and not used: {said}, and others.")
            if infinite.any() or outside.any():
                read.numbers[name] = np.where(infinite | outside, np.nan, values)
    if faults:
        raise InputError("; ".join(dict.fromkeys(faults)))
    return list(dict.fromkeys(notes)), left_out


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
    far = within & (np.abs(steps) > np.maximum(least, _ACCELERATION * np.diff(time_s)))
    up = np.where(far, np.sign(steps), 0.0)
    here, there = np.append(0.0, up), np.append(-up, 0.0)  # by how it differs from either side
    first, last = np.append(True, ~within), np.append(~within, True)
    found: np.ndarray = ((here * there > 0) | first | last) & ((here + there) * slip_mps > 0)
    return found


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
    found: np.ndarray = np.isfinite(values) & ((values < lower) | (values > upper))
    return found


def _said(values: np.ndarray, outside: np.ndarray, source: Taken, first_row: int) -> str:
    """The first value that cannot be, as a clause."""
    place = int(outside.argmax())
    value = float(values[place])
    column = COLUMNS[source.quantity]
    unit = "" if column.unit == "1" else f" {column.unit}"
    to = source.conversion
    written = "" if to == (1.0, 0.0) else f" ({to.back(value):g} {source.unit})"
    where = f"row {first_row + place} of column {source.column} has {value:.6g}{unit}{written}"
    if source.quantity in _LOADS:
        return f"{where}, under {percent(_LIFTED)} of the usual load ({column.advice})"
    return f"{where}, outside {column.span} ({column.advice})"


class Rows:
    """Numbers and labels of the rows that are used, [rows], by the names they are taken as.

    They are changed in place, for two copies of the columns of a long log do not fit in memory.
    """

    def __init__(self, read: Gathered, first_row: int, rows_of_file: int) -> None:
        self.numbers: dict[str, np.ndarray] = read.numbers
        self.labels: Mapping[str, pd.Categorical] = _within_files(
            read.labels, read.numbers.get("time_s")
        )
        #: The numbers that a user sees of the rows.
        self.index: pd.Index = pd.RangeIndex(first_row, first_row + rows_of_file)
        if read.rows > rows_of_file:  # repeats, one below the other
            self.index = pd.Index(np.tile(self.index, read.rows // rows_of_file))

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

    def in_time(self, column: str) -> list[str]:
        """Makes time go on within each run and axle where the clock stepped back; sentences."""
        if "time_s" not in self.numbers:
            return []
        time, used, notes = with_clock(self.numbers["time_s"], self.series, column, self.index)
        self.numbers["time_s"] = time
        self.keep(used)
        return notes

    def labelled(self) -> list[str]:
        """Keeps the rows that have a run, an axle and so on where there is such a column."""
        notes = []
        for name in LABELS:
            if name == "mode" or name not in self.labels:
                continue
            used = np.asarray(self.labels[name] != "")
            if not used.all():
                notes.append(f"{of_rows(~used)} the {name} is not named.")
                self.keep(used)
        modes = self.labels["mode"].categories if "mode" in self.labels else ()
        strange = [one for one in modes if one.lower() not in {"", *MODES}]
        if strange:
            own = {"mode": "mode (as it is)"}
            self.labels = {own.get(name, name): of for name, of in self.labels.items()}
            notes.append(
                f"The column mode keeps its labels, which are none of {listed([*MODES])}: "
                f"{listed(strange[:3])}."
            )
        return notes

    def within(self, computed: Iterable[str]) -> list[str]:
        """Keeps the rows whose computed values are not beyond what the others show; sentences."""
        notes = []
        for name in computed:
            wrong = ~np.isfinite(self.numbers[name]) | _outside(self.numbers[name], name)
            if wrong.any():
                place = int(wrong.argmax())
                notes.append(
                    f"{of_rows(wrong)} {name} comes out beyond what it is in the others; the first "
                    f"is row {self.index[place]}, with {number(float(self.numbers[name][place]))}."
                )
                self.keep(~wrong)
        return notes

    def without_leaps(self) -> list[str]:
        """Keeps the rows in which the speed of the wheel does not leap for one row; sentences."""
        if not {"slip_velocity_mps", "time_s"} <= {*self.numbers}:
            return []
        wrong = leaps(self.numbers["slip_velocity_mps"], self.numbers["time_s"], self.series)
        if not wrong.any():
            return []
        place = int(wrong.argmax())
        index, slip = self.index[place], float(self.numbers["slip_velocity_mps"][place])
        self.keep(~wrong)
        return [
            f"{of_rows(wrong)} the slip velocity leaps, for this row alone, further than a wheel "
            f"can be accelerated; the first is row {index}, with {number(slip)} m/s."
        ]


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
    codes, both = pd.factorize(file.codes.astype(np.int64) * width + run.codes)
    goes_on = _going_on(both % width, codes, time)
    in_files = np.bincount((both % width)[np.unique(goes_on)], minlength=width)
    names = [
        f"{of_file}:{name}" if name and count > 1 else name
        for of_file, name, count in zip(
            file.categories[both[goes_on] // width],
            run.categories[both % width],
            in_files[both % width],
            strict=True,
        )
    ]
    found, of_names = pd.factorize(np.array(names, dtype=object))
    return {
        **labels,
        "run": pd.Categorical.from_codes(found[codes], pd.Index(of_names, dtype="str")),
    }


def _going_on(runs: np.ndarray, part: np.ndarray, time: np.ndarray | None) -> np.ndarray:
    """The first part of the run that each part of it goes on, [parts], itself if it begins one.

    `runs` [parts] are the runs by number, in the order of the files, and `part` is that of each
    row, with the time in s.
    """
    first = np.arange(runs.size)
    if time is None:
        return first
    spans = pd.Series(time).groupby(part).agg(["min", "max"]).to_numpy()
    longest = longest_step(time, part)
    before: dict[int, int] = {}
    for one, run in enumerate(runs.tolist()):
        if run in before and 0 <= spans[one, 0] - spans[before[run], 1] <= longest:
            first[one] = first[before[run]]
        before[run] = one
    return first
