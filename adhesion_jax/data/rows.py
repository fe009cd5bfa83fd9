"""The rows of a log that are used: fewer with each step, and each step says which and why."""

from collections.abc import Iterable, Mapping

import numpy as np
import pandas as pd

from adhesion_jax.data.clock import with_clock
from adhesion_jax.data.columns import LABELS, MODES
from adhesion_jax.data.gaps import of_rows
from adhesion_jax.data.gathering import Gathered
from adhesion_jax.data.sizes import beyond, leaps
from adhesion_jax.data.stretches import longest_step, series_of
from adhesion_jax.wording import listed, number


class Rows:
    """Numbers and labels of the rows that are used, [rows], by the names they are taken as.

    They are changed in place, for two copies of the columns of a long log do not fit in memory.
    """

    def __init__(self, read: Gathered, first_row: int, rows_of_file: int) -> None:
        self.numbers: dict[str, np.ndarray] = read.numbers
        self.labels: Mapping[str, pd.Categorical] = _within_files(
            read.labels, read.numbers.get("time_s")
        )
        self.count = read.rows
        self._first_row, self._rows_of_file = first_row, rows_of_file
        self._places: np.ndarray | None = None  # of the rows that are left; all without
        if read.rows > rows_of_file:  # repeats, one below the other
            self._places = np.arange(read.rows)

    @property
    def index(self) -> pd.Index:
        """The numbers that a user sees of the rows."""
        if self._places is None:
            return pd.RangeIndex(self._first_row, self._first_row + self.count)
        return pd.Index(self._first_row + self._places % self._rows_of_file)

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
        there = np.arange(rows.size) if self._places is None else self._places
        self._places = there[rows]
        self.count = int(np.count_nonzero(rows))

    def in_time(self, column: str) -> list[str]:
        """Makes time go on within each run and axle where the clock stepped back; sentences."""
        if "time_s" not in self.numbers:
            return []
        index = self.index
        time, used, notes = with_clock(
            self.numbers["time_s"], self.series, column, lambda place: int(index[place])
        )
        self.numbers["time_s"] = time
        self.keep(used)
        return notes

    def labelled(self) -> list[str]:
        """Keeps the rows that have a run, an axle and so on where there is such a column."""
        notes = []
        for name in LABELS:
            if name not in self.labels:
                continue
            used = np.asarray(self.labels[name] != "")
            if name == "mode":
                known = {"", *MODES}
                strange = [one for one in self.labels[name].categories if one.lower() not in known]
                if strange:
                    own = "mode (as it is)"
                    self.labels = {
                        own if one == name else one: of for one, of in self.labels.items()
                    }
                    notes.append(
                        f"The column mode keeps its labels, which are none of {listed([*MODES])}: "
                        f"{listed(strange[:3])}."
                    )
                continue
            if not used.all():
                notes.append(f"{of_rows(~used)} the {name} is not named.")
                self.keep(used)
        return notes

    def within(self, computed: Iterable[str]) -> list[str]:
        """Keeps the rows whose computed values are not beyond what the others show; sentences."""
        notes = []
        for name in computed:
            wrong = beyond(self.numbers[name], name)
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
