"""Whether a table is valid: every cell finite and within its column's range, time in order."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
import pandera.pandas as pandera
import pyarrow
from pandera.errors import SchemaErrors

from adhesion_jax.data.columns import COLUMNS, LABELS, MODES

#: Spellings of a missing number; any other cell that is no number counts as text.
_MISSING = ("", "-", "na", "n/a", "nan", "nat", "none", "null", "<na>")


def numbers(cells: pd.DataFrame) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """The columns as numbers, NaN where a cell is none, and the names of those left out.

    A column the project does not know is kept where every cell is a finite number. Labels become
    text, empty where there is none.
    """
    kept: dict[str, pd.Series] = {}
    left_out: list[str] = []
    for name in cells.columns.astype(str):
        if name in LABELS:
            kept[name] = _as_labels(cells[name])
            continue
        number = _as_numbers(cells[name])
        if name in COLUMNS or np.isfinite(number).all():
            kept[name] = number
        else:
            left_out.append(name)
    return pd.DataFrame(kept, index=cells.index), tuple(left_out)


def cell_faults(table: pd.DataFrame, cells: pd.DataFrame) -> Sequence[str]:
    """The first cell of each column that is text, is missing, is infinite or is out of range.

    `cells` holds what was written where `table` has its numbers.
    """
    try:
        _SCHEMA.validate(table, lazy=True)
    except SchemaErrors as error:
        cases = error.failure_cases.sort_values("index", kind="stable", ignore_index=True)
        cases["kind"] = _kinds(cases, cells)
        first = cases.drop_duplicates(["column", "kind"])
        return [
            _sentence(name, int(row), kind, cells[name].loc[row])
            for name, row, kind in zip(first["column"], first["index"], first["kind"], strict=True)
        ]
    return []


def label_faults(table: pd.DataFrame) -> Sequence[str]:
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
                f"row {strange.index[0]} of column mode has the label '{_shown(strange.iloc[0])}' "
                f"(write {', '.join([*MODES][:-1])} or {[*MODES][-1]})"
            )
    return faults


def time_faults(table: pd.DataFrame) -> Sequence[str]:
    """The first row at which time runs backwards within a run."""
    if "time_s" not in table:
        return []
    run = table["run"] if "run" in table else pd.Series(0, index=table.index)
    back = table["time_s"].groupby(run).diff() < 0
    if not back.any():
        return []
    return [
        f"column time_s decreases in row {back.idxmax()} (sort each run by time, and number the "
        "runs in a column run)"
    ]


def _as_numbers(cells: pd.Series) -> pd.Series:
    if pd.api.types.is_bool_dtype(cells) or pd.api.types.is_numeric_dtype(cells):
        return cells.astype(float)
    # As text, because pandas would turn a date into its number of nanoseconds.
    text = cells.astype(str).str.strip()
    try:
        # This takes a tenth of the time of the way below, but fails if any cell is not a number.
        number = pyarrow.array(text).cast(pyarrow.float64()).to_numpy(zero_copy_only=False)
        return pd.Series(number, index=cells.index)
    except pyarrow.ArrowInvalid:
        return pd.to_numeric(text, errors="coerce").astype(float)


def _as_labels(cells: pd.Series) -> pd.Series:
    if pd.api.types.is_float_dtype(cells) and (cells.dropna() % 1 == 0).all():
        # Whole numbers may be written as 1.0 in one file and as 1 in another.
        cells = cells.astype("Int64")
    return cells.astype(object).where(cells.notna(), "").astype(str).str.strip()


def _kinds(cases: pd.DataFrame, cells: pd.DataFrame) -> pd.Series:
    """The kind of each fault: outside, infinite, missing or text."""
    kinds = pd.Series("infinite", index=cases.index, dtype=object)
    kinds[cases["check"] == "inside"] = "outside"
    no_number = (cases["check"] != "inside") & cases["failure_case"].isna()
    for name, failed in cases[no_number].groupby("column"):
        written = cells[name].loc[failed["index"].astype(int)].astype(object)
        blank = [str(cell).strip().lower() in _MISSING for cell in written]
        kinds[failed.index] = np.where(blank, "missing", "text")
    return kinds


def _shown(written: object) -> str:
    """The content of a cell on one line, cut to 30 characters."""
    return f"{' '.join(str(written).split()):.30}"


def _sentence(name: str, row: int, kind: str, written: object) -> str:
    column = COLUMNS[name]
    match kind:
        case "text":
            fault = f"the text '{_shown(written)}' (write a number, with a decimal point, no unit)"
        case "missing":
            fault = "no value (an empty cell or NaN: fill it in or leave out the row)"
        case "infinite":
            fault = "an infinite value (correct it or leave out the row)"
        case _:
            unit = "" if column.unit == "1" else f" {column.unit}"
            fault = (
                f"{written}, outside {column.lower:g} to {column.upper:g}{unit} ({column.advice})"
            )
    return f"row {row} of column {name} has {fault}"


def _finite(values: pd.Series) -> pd.Series:
    return pd.Series(np.isfinite(values), index=values.index)


def _inside(name: str) -> pandera.Check:
    column = COLUMNS[name]
    return pandera.Check(
        # A cell that is not finite is reported as such, and not also as out of range.
        lambda values: values.between(column.lower, column.upper) | ~_finite(values),
        name="inside",
    )


_SCHEMA = pandera.DataFrameSchema(
    {
        name: pandera.Column(
            float,
            [pandera.Check(_finite, name="finite", ignore_na=False), _inside(name)],
            nullable=True,
            required=False,
        )
        for name in COLUMNS
    }
)
