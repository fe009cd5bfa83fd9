"""Cells as numbers, dates and times of day: a block of a column at a time."""

import re
from collections.abc import Iterable, Sequence
from contextlib import suppress

import numpy as np
import pandas as pd
import pyarrow
import pyarrow.compute

#: Spellings of a missing number; any other cell that is no number counts as text.
MISSING = (
    *("", "-", "--", "NA", "N/A", "n/a", "na", "NaN", "nan", "NAN", "NaT", "None", "none", "null"),
    *("NULL", "<NA>", "#NV", "#N/A"),
)

#: Those of a missing label: a rail with the lubricant "none" is a dry one.
MISSING_LABEL = ("", "NaN", "nan", "NAN", "NaT", "<NA>", "#NV", "#N/A")

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

#: A number by either decimal mark.
OF_TWO_MEANINGS = r"^[+-]?[1-9]\d{0,2}(,\d{3})+$"

#: Spellings of a flag, in small letters.
_FLAGS = {
    "1": ("on", "yes", "true", "ein", "an", "ja", "wahr"),
    "0": ("off", "no", "false", "aus", "nein", "falsch"),
}

_NOWHERE = np.empty(0, np.int64)


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


def numbers(cells: pyarrow.Array, mark: str = ".") -> tuple[np.ndarray, np.ndarray]:
    """The cells as numbers, NaN where there is none, and the places of those that are text.

    The mark is the decimal one; the other mark may part thousands. Cells of another kind than text
    are taken as they are.
    """
    if not is_text(cells.type):
        if pyarrow.types.is_boolean(cells.type):
            cells = cells.cast(pyarrow.uint8())
        try:
            return _array(cells.cast(pyarrow.float64(), safe=False)), _NOWHERE
        except (pyarrow.ArrowNotImplementedError, pyarrow.ArrowInvalid):
            return np.full(len(cells), np.nan), np.arange(len(cells))
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
        text = known(compute.utf8_trim_whitespace(cells) if trimmed else cells)
        with suppress(pyarrow.ArrowInvalid):
            return _array(text.cast(pyarrow.float64())), _NOWHERE
    with suppress(pyarrow.ArrowInvalid):  # True and False, which are 1 and 0
        return numbers(text.cast(pyarrow.bool_()))
    values = pd.to_numeric(text.to_pandas().astype(object), errors="coerce").to_numpy(float)
    return values, np.flatnonzero(_array(text.is_valid()) & np.isnan(values))


def flags(cells: pyarrow.Array) -> pyarrow.Array:
    """The cells with 1 and 0 for the spellings of a flag, in any case of their letters."""
    if not is_text(cells.type):
        return cells
    compute = pyarrow.compute
    words = compute.utf8_lower(compute.utf8_trim_whitespace(cells))
    for number, spellings in _FLAGS.items():
        cells = compute.if_else(compute.is_in(words, pyarrow.array(spellings)), number, cells)
    return cells


def known(text: pyarrow.Array) -> pyarrow.Array:
    """The text, null where it is a spelling of a missing number."""
    missing = pyarrow.compute.is_in(text, pyarrow.array(MISSING))
    return pyarrow.compute.if_else(missing, pyarrow.scalar(None, text.type), text)


def is_text(kind: pyarrow.DataType) -> bool:
    return bool(pyarrow.types.is_string(kind) or pyarrow.types.is_large_string(kind))


def _array(values: pyarrow.Array) -> np.ndarray:
    # A null becomes NaN.
    return np.asarray(values.to_numpy(zero_copy_only=False))


_MINUTES = r":\d{2}(:\d{2}([.,:]\d{1,9})?)?"
_HALF = r"\s*[AaPp]\.?[Mm]\.?"
_CLOCK = rf"(?:\d{{1,2}}{_MINUTES}|(?:0?[1-9]|1[0-2]){_MINUTES}{_HALF})"
_ZONE = r"\s*(Z|[+-]\d{2}:?\d{2})"

#: The form of a stamp that says no day.
TIME_OF_DAY = "a time of day"

#: The form of minutes and seconds with a fraction, as spreadsheets save times of day.
TIME_OF_HOUR = "a time within the hour"

#: The form of a stamp that says no day, and after what time, in s, it begins anew.
CLOCKS = {TIME_OF_DAY: 86400.0, TIME_OF_HOUR: 3600.0}

#: The form of a day without a time, year first.
A_DATE = "a date"

#: What follows the form of a date where it goes on with a time.
AND_TIME = " and time"

#: What stands before it where each stamp says its zone.
WITH_ZONE = " with zone"

#: Dates of which the first number may be the day or the month, and the two ways to read them.
EITHER = "day/month/year or month/day/year"
ORDERS = ("day/month/year", "month/day/year")

#: Form of a date to the pattern of it; what is written with slashes has one of three forms.
_SLASHES = "slashes"
_DATES = {
    A_DATE: r"\d{4}[-/]\d{2}[-/]\d{2}",
    "day.month.year": r"\d{1,2}\.\d{1,2}\.\d{2,4}",
    "day-month-year": r"\d{1,2}[- ][A-Za-z]{3}[- ]\d{4}",
    _SLASHES: r"\d{1,2}/\d{1,2}/\d{4}",
}
_FORMS = {
    TIME_OF_DAY: re.compile(_CLOCK),
    TIME_OF_HOUR: re.compile(r"\d{1,2}:\d{2}[.,]\d{1,9}"),
    **{form: re.compile(date) for form, date in _DATES.items()},
    **{
        form + WITH_ZONE + AND_TIME: re.compile(rf"{date}[T ,]\s*{_CLOCK}{_ZONE}")
        for form, date in _DATES.items()
    },
    **{
        # Spreadsheets write midnight as the date alone.
        form + AND_TIME: re.compile(rf"{date}([T ,]\s*{_CLOCK}({_ZONE})?)?")
        for form, date in _DATES.items()
    },
}

_MONTHS = ["jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec"]

#: From what is written to year-month-day and a time with a decimal point, step by step.
_STEPS = (
    (r"^(\d)([- ][A-Za-z])", r"0\1\2"),
    *(
        (rf"(?i)^(\d\d)[- ]{month}[- ](\d{{4}})", rf"\2-{number:02d}-\1")
        for number, month in enumerate(_MONTHS, 1)
    ),
    (r"^(\d)([./])", r"0\1\2"),
    (r"^(\d\d[./])(\d)([./])", r"\10\2\3"),
    (r"^(\d\d)\.(\d\d)\.(\d\d)([T ,]|$)", r"\1.\2.20\3\4"),
    (r"^(\d\d)[./](\d\d)[./](\d{4})", r"\3-\2-\1"),
    (r"^(\d{4})/(\d\d)/(\d\d)", r"\1-\2-\3"),
    (r"^(\S{10})(,\s*|[T ]\s+)", r"\1 "),
    (r"^(\d):", r"0\1:"),
    (r" (\d):", r" 0\1:"),
    (r"(:\d\d:\d\d)[,:](\d+)", r"\1.\2"),
)
_MONTH_FIRST = (r"^(\d{1,2})/(\d{1,2})/", r"\2/\1/")

_HALF_A_DAY = 12 * 3600 * 10**9


def form_of(cells: Sequence[str]) -> str:
    """In which form cells hold dates, times of day or both; empty where they hold none.

    Of dates such as 03/04/2026 the form is that of EITHER as long as both numbers are at most 12.
    """
    written = [cell.strip() for cell in cells if cell.strip() not in MISSING]
    for form, pattern in _FORMS.items():
        if written and all(pattern.fullmatch(cell) for cell in written):
            return form.replace(_SLASHES, _order(written)) if _order(written) else ""
    return ""


def _order(dates: Sequence[str]) -> str:
    """Whether the day or the month comes first in dates with slashes; empty where neither can."""
    numbers = [[int(part) for part in date.split("/")[:2]] for date in dates if "/" in date]
    largest = [max(part) for part in zip(*numbers, strict=True)] or [0, 0]
    possible = [order for order, month in zip(ORDERS, largest[::-1], strict=True) if month <= 12]
    return EITHER if len(possible) == 2 else "".join(possible)


def stamps(cells: pyarrow.Array, form: str = "") -> tuple[pyarrow.Int64Array, np.ndarray]:
    """The cells in nanoseconds, null where there are none, and the places of those that are text.

    They are text of a form of `form_of` or stamps of their own kind, and count from 1970, or for a
    time of day from midnight.
    """
    kind = cells.type
    if pyarrow.types.is_timestamp(kind):
        ticks = cells.cast(pyarrow.timestamp("ns", kind.tz), safe=False)
        return ticks.cast(pyarrow.int64()), _NOWHERE
    if pyarrow.types.is_duration(kind):
        return cells.cast(pyarrow.duration("ns"), safe=False).cast(pyarrow.int64()), _NOWHERE
    if pyarrow.types.is_time(kind):
        return cells.cast(pyarrow.time64("ns")).cast(pyarrow.int64()), _NOWHERE
    compute = pyarrow.compute
    text = known(compute.utf8_trim_whitespace(cells))
    halves = compute.match_substring_regex(text, rf"{_HALF}$")
    if compute.any(halves).as_py():
        ticks, strange = stamps(compute.replace_substring_regex(text, rf"{_HALF}$", ""), form)
        afternoon = compute.match_substring_regex(text, r"[Pp]\.?[Mm]\.?$")
        twelve = compute.and_(halves, compute.match_substring_regex(text, r"(^|\D)12:"))
        later, earlier = (one.cast(pyarrow.int64()) for one in (afternoon, twelve))
        half_days = compute.subtract(later, earlier)
        return compute.add(ticks, compute.multiply(half_days, _HALF_A_DAY)), strange
    if form == TIME_OF_HOUR:
        text = compute.binary_join_element_wise("00", text, ":")
    if form.startswith(ORDERS[1]):
        text = compute.replace_substring_regex(text, *_MONTH_FIRST)
    shown = text.drop_null()[:1].to_pylist()
    # The steps that the first cell needs, for each takes as long as all the rest; then all of them.
    for steps in ([step for step in _STEPS if shown and re.search(step[0], shown[0])], _STEPS):
        written = _normal(text, steps)
        zoned = compute.any(compute.match_substring_regex(written, rf"{_ZONE}$")).as_py()
        with suppress(pyarrow.ArrowInvalid):
            return stamps(written.cast(pyarrow.timestamp("ns", "UTC" if zoned else None)))
    series = pd.to_datetime(written.to_pandas(), errors="coerce", format="ISO8601", utc=True)
    found = pyarrow.array(series, pyarrow.timestamp("ns", "UTC"))
    return stamps(found)[0], np.flatnonzero(_array(text.is_valid()) & _array(found.is_null()))


def _normal(text: pyarrow.Array, steps: Sequence[tuple[str, str]]) -> pyarrow.Array:
    """The text as year-month-day and time, after these steps; a time of day is of 1970-01-01."""
    compute = pyarrow.compute
    for pattern, written in steps:
        text = compute.replace_substring_regex(text, pattern, written)
    clock = compute.match_substring_regex(text, r"^\d\d:")
    if not compute.any(clock).as_py():
        return text
    return compute.if_else(clock, compute.binary_join_element_wise("1970-01-01", text, " "), text)


def seconds(ticks: pyarrow.Int64Array, origin: int) -> np.ndarray:
    """Seconds since the origin; a difference of integers, which keeps the digits of a stamp."""
    return _array(pyarrow.compute.subtract(ticks, origin).cast(pyarrow.float64(), safe=False)) / 1e9


def unwrapped(seconds: np.ndarray, period: float) -> np.ndarray:
    """Times [rows] that begin anew after a period: it is added at each fall by half of it."""
    known = np.flatnonzero(np.isfinite(seconds))
    anew = np.cumsum(np.diff(seconds[known], prepend=seconds[known[:1]]) < -period / 2)
    found = seconds.copy()
    found[known] += period * anew
    return found
