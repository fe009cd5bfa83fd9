"""Whether columns are valid: every value finite and within its column's range, time in order."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from adhesion_jax.data.columns import COLUMNS, LABELS, MODES
from adhesion_jax.data.understanding import Taken


def text_fault(row: int, column: str, written: object) -> str:
    """What is said of a cell that is text where a number belongs."""
    if str(written).strip() == column:
        return f"row {row} is the header again (leave that row out)"
    return (
        f"row {row} of column {column} has the text '{shown(written)}' (write a number, with a "
        "decimal point, no unit)"
    )


def shown(written: object) -> str:
    """The content of a cell on one line, cut to 30 characters."""
    return f"{' '.join(str(written).split()):.30}"


def range_faults(
    columns: Mapping[str, np.ndarray], taken: Mapping[str, Taken], row_of: range | pd.Index
) -> Sequence[str]:
    """The first value of each known column that is infinite or out of range; NaN is no fault.

    `taken` says in which column of the file a quantity was found, if it was; `row_of` are the
    numbers of the rows.
    """
    faults = []
    for name, values in columns.items():
        if name not in COLUMNS:
            continue
        column = COLUMNS[name]
        source = taken.get(name)
        label = source.column if source else name
        wrong = np.flatnonzero((values < column.lower) | (values > column.upper))
        infinite = wrong[np.isinf(values[wrong])]
        outside = wrong[np.isfinite(values[wrong])]
        if infinite.size:
            faults.append(
                f"row {row_of[infinite[0]]} of column {label} has an infinite value (correct it or "
                "leave out the row)"
            )
        if outside.size:
            value = float(values[outside[0]])
            written = "" if source is None else _as_written(value, source)
            unit = "" if column.unit == "1" else f" {column.unit}"
            faults.append(
                f"row {row_of[outside[0]]} of column {label} has {value!r}{unit}{written}, outside "
                f"{column.lower:g} to {column.upper:g}{unit} ({column.advice})"
            )
    return faults


def _as_written(value: float, source: Taken) -> str:
    to = source.conversion
    if (to.factor, to.offset) == (1.0, 0.0):
        return ""
    return f" ({(value - to.offset) / to.factor:g} {source.unit})"


def label_faults(table: Mapping[str, pd.Series]) -> Sequence[str]:
    """The first row of each column of labels that has none, or a mode that is not one."""
    faults = []
    for name in LABELS:
        if name not in table:
            continue
        empty = table[name] == ""
        if empty.any():
            faults.append(
                f"row {empty.idxmax()} of column {name} has no value (name it in each row)"
            )
    if "mode" in table:
        strange = table["mode"][~table["mode"].str.lower().isin(["", *MODES])]
        if len(strange):
            faults.append(
                f"row {strange.index[0]} of column mode has the label '{shown(strange.iloc[0])}' "
                f"(write {', '.join([*MODES][:-1])} or {[*MODES][-1]})"
            )
    return faults


def steps_in_runs(time: np.ndarray, run: np.ndarray) -> np.ndarray:
    """The time of each row less that of the row before in its run; NaN without one, [rows].

    `run` has the number of the run of each row.
    """
    order = None if (run[1:] >= run[:-1]).all() else np.argsort(run, kind="stable")
    if order is not None:
        time, run = time[order], run[order]
    steps = np.diff(time, prepend=np.nan)
    steps[1:][run[1:] != run[:-1]] = np.nan
    if order is not None:
        steps[order] = steps.copy()
    return steps


def time_faults(table: pd.DataFrame, column: str) -> Sequence[str]:
    """The first row at which time, which is in this column, runs backwards within a run."""
    if "time_s" not in table:
        return []
    run = pd.factorize(table["run"])[0] if "run" in table else np.zeros(len(table), np.int8)
    back = steps_in_runs(table["time_s"].to_numpy(), run) < 0
    if not back.any():
        return []
    row = table.index[int(back.argmax())]
    return [
        f"column {column} decreases in row {row} (sort each run by time, and number the runs in "
        "a column run)"
    ]


def unusual(columns: Mapping[str, np.ndarray], taken: Mapping[str, Taken]) -> Sequence[str]:
    """Warnings where a column is of the size that another unit would give."""
    found = []
    for name, source in taken.items():
        if name not in COLUMNS or name not in columns or not columns[name].size:
            continue
        least, most = COLUMNS[name].usual
        largest = float(np.max(np.abs(columns[name])))
        unit = COLUMNS[name].unit
        if not least <= largest <= most:
            found.append(
                f"Check the unit of column {source.column}: its largest value, {largest:g} {unit}, "
                f"is unusual for this quantity ({least:g} to {most:g} {unit})."
            )
    slip = taken.get("slip_ratio")
    if slip is not None and np.quantile(np.abs(columns["slip_ratio"]), 0.9) > _LARGE_SLIP:
        found.append(
            f"Check the unit of column {slip.column}: a tenth of its slips exceed {_LARGE_SLIP}, "
            "which is unusual for ratios (they may be in per cent)."
        )
    return found


#: A tenth of all slips rarely exceeds this ratio.
_LARGE_SLIP = 0.3
