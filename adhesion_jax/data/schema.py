"""Which tables are sane: every cell a finite number inside its column's range, time in order."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
import pandera.pandas as pandera
from pandera.errors import SchemaErrors

from adhesion_jax.data.columns import COLUMNS, LABELS

#: How a missing number is written; anything else that is no number is text.
_MISSING = ("", "-", "na", "n/a", "nan", "nat", "none", "null", "<na>")


def numbers(cells: pd.DataFrame) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """The columns as numbers, NaN where a cell is none, and the names of those left out.

    A column the project does not know is kept where every cell is a finite number. Labels become
    text.
    """
    kept: dict[str, pd.Series] = {}
    left_out: list[str] = []
    for name in cells.columns.astype(str):
        if name in LABELS:
            kept[name] = cells[name].astype(str)
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
        found: dict[tuple[str, str], str] = {}
        for case in error.failure_cases.sort_values("index", kind="stable").to_dict("records"):
            name, row = str(case["column"]), int(case["index"])
            kind = _kind(case, cells.loc[row, name])
            if (name, kind) not in found:
                found[name, kind] = _sentence(name, row, kind, cells.loc[row, name])
        return list(found.values())
    return []


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
    # As text, for pandas would take a date for its nanoseconds.
    return pd.to_numeric(cells.astype(str).str.strip(), errors="coerce").astype(float)


def _kind(case: Mapping[str, object], written: object) -> str:
    if case["check"] == "inside":
        return "outside"
    if not pd.isna(case["failure_case"]):  # type: ignore[call-overload]
        return "infinite"
    return "missing" if str(written).strip().lower() in _MISSING else "text"


def _sentence(name: str, row: int, kind: str, written: object) -> str:
    column = COLUMNS[name]
    match kind:
        case "text":
            fault = f"the text '{written!s:.30}' (write a number, with a decimal point, no unit)"
        case "missing":
            fault = "no value (an empty cell or NaN: fill it in or leave out the row)"
        case "infinite":
            fault = "an infinite value (correct it or leave out the row)"
        case _:
            unit = "" if column.unit == "1" else f" {column.unit}"
            fault = (
                f"{written}, outside {column.lower:g} to {column.upper:g}{unit} ({column.advice})"
            )
    return f"column {name} has in row {row} {fault}"


def _finite(values: pd.Series) -> pd.Series:
    return pd.Series(np.isfinite(values), index=values.index)


def _inside(name: str) -> pandera.Check:
    column = COLUMNS[name]
    return pandera.Check(
        # What is not finite is reported as such, once.
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
