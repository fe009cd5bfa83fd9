"""Cells as numbers: a block of a column at a time, never a cell at a time."""

import re
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import pandas as pd
import pyarrow
import pyarrow.compute

#: Spellings of a missing number; any other cell that is no number counts as text.
MISSING = (
    *("", "-", "--", "NA", "N/A", "n/a", "na", "NaN", "nan", "NAN", "NaT", "None", "none", "null"),
    *("NULL", "<NA>", "#NV", "#N/A"),
)

#: Numbers that can be read in one way only if the mark is a comma, or a point: not 1,234, which
#: may be one and a quarter or a thousand. A group after a thousands mark has three digits, and the
#: first does not begin with 0.
_DECIDES = {
    mark: re.compile(
        rf"[+-]?(?:(?!(?:[1-9]\d{{0,2}})\{mark}\d{{3}}$)\d*\{mark}\d+|[1-9]\d{{0,2}}(?:\{other}\d{{3}})+"
        rf"\{mark}\d+)(?:[eE][+-]?\d+)?"
    )
    for mark, other in ((",", "."), (".", ","))
}
_NUMBER = re.compile(r"[+-]?[.,]?\d[\d.,]*(?:[eE][+-]?\d+)?")
_EITHER = r"^[+-]?[1-9]\d{0,2}(,\d{3})+$"


_NO_TEXT = np.empty(0, np.int64)


class Numbers(NamedTuple):
    """The numbers of a block of cells, NaN where there is none; the places of those of text."""

    values: np.ndarray
    text: np.ndarray  # [cells that are text]


def decimal_mark(cells: Iterable[str]) -> str | None:
    """The decimal mark of most of the cells that show one; None where none does."""
    votes = dict.fromkeys(_DECIDES, 0)
    for cell in cells:
        for mark, pattern in _DECIDES.items():
            votes[mark] += pattern.fullmatch(cell.strip()) is not None
    return max(votes, key=lambda mark: votes[mark]) if any(votes.values()) else None


def numbers_in(cells: Iterable[str]) -> list[str]:
    """Those of the cells that are numbers, by whatever decimal mark."""
    return [cell for cell in cells if _NUMBER.fullmatch(cell.strip())]


def first_of_two_meanings(cells: pyarrow.Array) -> int | None:
    """The place of the first cell such as 1,234, which is a number by either decimal mark."""
    if not is_text(cells.type):
        return None
    either = pyarrow.compute.match_substring_regex(cells, _EITHER)
    place = pyarrow.compute.index(either, True).as_py()
    return None if place < 0 else int(place)


def numbers(cells: pyarrow.Array, mark: str = ".") -> Numbers:
    """The cells as numbers, by the decimal mark; the other mark may part thousands.

    Cells of another kind than text are taken as they are.
    """
    if not is_text(cells.type):
        if pyarrow.types.is_boolean(cells.type):
            cells = cells.cast(pyarrow.uint8())
        try:
            values = cells.cast(pyarrow.float64(), safe=False)
        except (pyarrow.ArrowNotImplementedError, pyarrow.ArrowInvalid):
            text = pyarrow.array([str(cell) for cell in cells.to_pylist()], pyarrow.string())
            return Numbers(np.full(len(cells), np.nan), _places(text.is_valid()))
        return Numbers(_array(values), _NO_TEXT)
    compute = pyarrow.compute
    other = "," if mark == "." else "."
    strange = compute.match_substring(cells, other)
    if compute.any(strange).as_py():
        pattern = rf"^\s*[+-]?[1-9]\d{{0,2}}(\{other}\d{{3}})+(\{mark}\d+)?\s*$"
        grouped = compute.match_substring_regex(cells, pattern)
        cells = compute.if_else(
            grouped,
            compute.replace_substring(cells, other, ""),
            compute.if_else(strange, "?", cells),
        )
    if mark == ",":
        cells = compute.replace_substring(cells, ",", ".")
    for trimmed in (False, True):
        try:
            values = _array(_without_missing(cells, trimmed).cast(pyarrow.float64()))
            return Numbers(values, _NO_TEXT)
        except pyarrow.ArrowInvalid:
            continue
    text = _without_missing(cells, True)
    values = pd.to_numeric(text.to_pandas().astype(object), errors="coerce").to_numpy(float)
    strange = compute.and_(text.is_valid(), pyarrow.array(np.isnan(values)))
    return Numbers(values, _places(strange))


def is_text(kind: pyarrow.DataType) -> bool:
    return bool(pyarrow.types.is_string(kind) or pyarrow.types.is_large_string(kind))


def _without_missing(cells: pyarrow.Array, trimmed: bool) -> pyarrow.Array:
    if trimmed:
        cells = pyarrow.compute.utf8_trim_whitespace(cells)
    missing = pyarrow.compute.is_in(cells, pyarrow.array(MISSING))
    return pyarrow.compute.if_else(missing, pyarrow.scalar(None, cells.type), cells)


def _array(values: pyarrow.Array) -> np.ndarray:
    # A null becomes NaN.
    found: np.ndarray = values.to_numpy(zero_copy_only=False)
    return found


def _places(mask: pyarrow.Array) -> np.ndarray:
    return np.flatnonzero(mask.to_numpy(zero_copy_only=False))
