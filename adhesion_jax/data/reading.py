"""From a file to a validated measured record."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import pandas as pd
from pandas.api.types import is_numeric_dtype

from adhesion_jax.data.columns import COLUMNS
from adhesion_jax.data.derived import SOURCES, derive, needed, without_delays
from adhesion_jax.data.files import Sheet, sheet_of, sheet_of_frame, with_dates_joined
from adhesion_jax.data.forces import NOTHING, Corrections
from adhesion_jax.data.gathering import gather, of_means, stack, with_scatter
from adhesion_jax.data.lateness import late_signals
from adhesion_jax.data.plausible import (
    exchanged,
    refuse_other_units,
    slip_beside_speeds,
    speed_warnings,
    unusual,
)
from adhesion_jax.data.rows import MOST, Rows
from adhesion_jax.data.stretches import FEW
from adhesion_jax.data.understanding import Taken, Understanding, understand
from adhesion_jax.errors import InputError
from adhesion_jax.records import Record
from adhesion_jax.runtime import silent
from adhesion_jax.wording import percent

#: A curve has up to five parameters; with fewer points its errors could not be estimated.
POINTS = 10

#: The first rows that nearly always hold enough different slips: to count all takes seconds.
_SOME = 10_000

#: A wheel rolls where adhesion is at most this share of the largest.
_ROLLING = 0.1

Progress = Callable[[str, float], None]


class NotUnderstoodError(InputError):
    """Columns are lacking, or in doubt; `understood` is the table of those that are not.

    It is as that of `Measured`, with the ranges of the first rows.
    """

    def __init__(self, sentence: str, understood: pd.DataFrame) -> None:
        super().__init__(sentence)
        self.understood = understood


class Measured(NamedTuple):
    """A validated table: SI units, one row a point, what could be derived added to it."""

    name: str  # the file it was read from
    table: pd.DataFrame  # its index holds the row numbers that a user sees there
    slip: str  # the column that is the slip: slip_ratio, or slip_velocity_mps without a speed
    covariates: tuple[str, ...]  # numeric columns that the project does not know
    left_out: Mapping[str, str]  # columns that are not used, each with the clause why
    understood: pd.DataFrame  # a row a column: column, taken_as, unit, lowest, highest, missing
    notes: tuple[str, ...]  # sentences on how the file was read and which rows are not used
    gaps: tuple[str, ...]  # those of them on rows without a value


def read_measured(
    path: Path,
    columns: Mapping[str, object] | None = None,
    known: Corrections = NOTHING,
    progress: Progress = silent,
    few: float = FEW,
) -> Measured:
    """A measured table with slip and adhesion from a file; see `to_measured`.

    Read are the files of `files.ENDINGS`, and folders and patterns of these as one log. In text,
    cells are separated by commas, semicolons, tabs or bars, numbers have a decimal point or comma,
    and a row of units may stand under the header. `known` is what is corrected, and of which
    sensors the columns do not tell. `progress` is called with words and the share that is read.
    `few` is the largest share of rows that is left out for the sake of columns that are not needed.
    """
    return _measured(sheet_of(path), columns, known, progress, few)


def to_measured(
    name: str,
    frame: pd.DataFrame,
    columns: Mapping[str, object] | None = None,
    known: Corrections = NOTHING,
    few: float = FEW,
) -> Measured:
    """A measured table with slip and adhesion, or InputError naming all that is wrong with it.

    Needed are slip_ratio, or what `derive` computes it from, and adhesion, or force and load of one
    body. Columns are taken for these by their names and units, or as `columns` says, see
    `understanding.said`. The other columns of COLUMNS and LABELS are checked where they are there;
    further numeric ones are kept as covariates. Rows with a gap in a column that is needed are left
    out, and so are those with a gap in another one that is not bridged (`Rows.bridged`), as long as
    these are few, at most that share of all; otherwise that column is left out. Whether the points
    are of use is for `check_curve` and `to_runs` to say.
    """
    return _measured(sheet_of_frame(frame, name), columns, known, silent, few)


def read_all(
    paths: Sequence[Path],
    columns: Mapping[str, object] | None = None,
    known: Corrections = NOTHING,
    progress: Progress = silent,
    few: float = FEW,
) -> list[Measured]:
    """Every file as by `read_measured`; InputError naming all that is wrong with any of them."""
    files: list[Measured] = []
    faults: list[str] = []
    seen: set[Path] = set()
    for number, path in enumerate(paths):
        if path.resolve() in seen:
            faults.append(f"{path} is given twice, name every file once")
            continue
        seen.add(path.resolve())

        def of_all(words: str, share: float, before: int = number) -> None:
            progress(words, (before + share) / len(paths))

        try:
            files.append(read_measured(path, columns, known, of_all, few))
        except InputError as error:
            if len(paths) == 1:
                raise
            faults.append(str(error).removesuffix("."))
    if faults:
        raise InputError(f"{'; '.join(faults)}.")
    return files


def _measured(
    sheet: Sheet,
    columns: Mapping[str, object] | None,
    known: Corrections,
    progress: Progress,
    few: float,
) -> Measured:
    sheet = with_dates_joined(sheet)
    found = understand(sheet, columns or {}, known.axles)
    names_needed, missing = needed({one.name for one in found.taken} | {*found.constants})
    if missing:
        some = gather(sheet.head(), found.taken, silent)
        table = pd.DataFrame([*_understood(found.taken, some)], columns=[*_UNDERSTOOD])
        fault = _asked(sheet, found, missing)
        raise NotUnderstoodError(f"{sheet.name} cannot be used: {fault}.", table)
    rows = gather(sheet, found.taken, progress)
    try:
        return _used(sheet, found, rows, names_needed, known, few)
    except InputError as error:
        raise InputError(f"{sheet.name} cannot be used: {error}.") from None


def _used(
    sheet: Sheet,
    found: Understanding,
    rows: Rows,
    names_needed: Sequence[str],
    known: Corrections,
    few: float,
) -> Measured:
    """The rows of a sheet that are used, with what is derived; InputError is a clause here."""
    if not rows.count:
        raise InputError(_too_few(0))
    understood = [*_understood(found.taken, rows)]
    taken = {one.name: one for one in found.taken if one.name in rows.numbers}
    rows.set_aside(taken, {*names_needed, "time_s"})
    side_by_side = stack(rows, found.taken, found.copies)
    rows.in_time(taken["time_s"].column if "time_s" in taken else "time_s")
    rows.labelled()
    there = [name for name in names_needed if name in rows.numbers]
    rows.bridged(there)
    rows.without_gaps(there, few)
    of_gaps = tuple(rows.notes)
    rows.updated()
    numbers = rows.numbers
    for name, value in found.constants.items():
        numbers[name] = np.full(rows.count, value)
        understood.append(("constant", name, COLUMNS[name].unit, value, value, 0.0))
    of_means(rows)
    without_delays(rows, known.delays)
    beside = slip_beside_speeds(numbers, taken)
    derive(rows, known)
    rows.within()
    rows.without_leaps()
    # Two speeds are compared where the slip is theirs and nothing was said of a delay.
    if "slip_velocity_mps" in rows.computed and not known.delays:
        rows.notes += late_signals(numbers, rows.labels)
    table = pd.DataFrame({**numbers, **rows.labels}, index=rows.index, copy=False)
    slip = "slip_ratio" if "slip_ratio" in table else "slip_velocity_mps"
    table, of_scatter = with_scatter(table, slip)
    if of_scatter:
        rows.computed["adhesion_sd"] = "scatter of the repeats"
    understood += [
        (f"computed: {source}", name, COLUMNS[name].unit, table[name].min(), table[name].max(), 0.0)
        for name, source in rows.computed.items()
    ]
    return Measured(
        sheet.name,
        table,
        slip,
        tuple(name for name in numbers if name not in COLUMNS),
        rows.left_out,
        pd.DataFrame(understood, columns=[*_UNDERSTOOD]),
        (
            *_format_notes(sheet, found, rows),
            *side_by_side,
            *rows.notes,
            *of_scatter,
            *unusual(numbers, taken),
            *refuse_other_units(numbers, taken),
            *beside,
            *filter(None, [exchanged(table[slip].to_numpy(), table["adhesion"].to_numpy())]),
            *speed_warnings(numbers, taken),
        ),
        of_gaps,
    )


_UNDERSTOOD = ("column", "taken_as", "unit", "lowest", "highest", "missing")
_NO_RANGE = (np.nan, np.nan, 0.0)

#: How many columns are named where none of them is what is needed.
_TOLD = 40


def _understood(taken: Sequence[Taken], read: Rows) -> Iterator[tuple[object, ...]]:
    """The rows of the table of what was understood; ranges are in the unit beside them."""
    for one in taken:
        if one.name in read.labels:
            yield one.column, one.name, "", *_NO_RANGE
        elif one.name in read.numbers:
            values = read.numbers[one.name]
            known = values[np.isfinite(values)]
            span = _NO_RANGE[:2]
            if known.size:
                ends = [one.conversion.back(end) for end in (known.min(), known.max())]
                span = min(ends), max(ends)
            missing = float(np.isnan(values).mean()) if values.size else 0.0
            yield one.column, one.quantity, one.stamp or one.unit, *span, missing


def _asked(sheet: Sheet, found: Understanding, missing: Sequence[str]) -> str:
    """What is missing, and what must be told of the columns that may be it."""
    there = ", ".join(sheet.columns[:_TOLD]) or "no column"
    more = " ..." if len(sheet.columns) > _TOLD else ""
    asked = [one.question for one in found.questions.values() if {*one.quantities} & SOURCES]
    asked = asked or ['which column it is (--column "QUANTITY=COLUMN [UNIT]")']
    return f"{'; '.join(missing)} (there are {there}{more}); please say {'; '.join(asked)}"


def _format_notes(sheet: Sheet, found: Understanding, rows: Rows) -> list[str]:
    notes = [f"The log has {sheet.format}."] if sheet.format else []
    if rows.origin:
        notes.append(f"The time counts from {rows.origin}.")
    notes += [f"The column {name} is left out: {why}." for name, why in rows.left_out.items()]
    notes += [
        f"The column {name} is left out: it may be a force, which is what the adhesion explains."
        for name in found.left_out
    ]
    notes += [
        f"The column {name} is not used as a time: its cells have no form of dates or times that "
        "is read (write them as 2026-11-24 08:00:00.010)."
        if one.quantities == ("time_s",) and name not in rows.numbers
        else f"The column {name} keeps its name: it is not known {one.question}."
        for name, one in found.questions.items()
        if name not in found.left_out
    ]
    return notes


def check_curve(measured: Measured) -> None:
    """Raises InputError if no curve can be identified although every cell is valid."""
    slip, fault = measured.table[measured.slip], ""
    different = slip[:_SOME].abs().nunique()
    if different < POINTS // 2:
        different = slip.abs().nunique()
    if different < POINTS // 2:
        sizes = "slips of one size" if different == 1 else f"slips of {different} sizes"
        fault = f"column {slip.name} has {sizes} alone (a curve needs at least {POINTS // 2})"
    refuse_useless(measured, fault)


def refuse_useless(measured: Measured, fault: str) -> None:
    """Raises InputError for too few points, for a further fault, or for an impossible adhesion."""
    slip, adhesion = measured.table[measured.slip], measured.table["adhesion"]
    speed = measured.table.get("vehicle_speed_mps", 1.0)
    fault = _too_few(len(slip)) or fault or _adhesion_fault(slip, adhesion, speed)
    if fault:
        raise InputError(f"{measured.name} cannot be used: {fault}.")


def _too_few(points: int) -> str:
    """A clause on a table that has fewer than POINTS points; empty if it has as many."""
    if points >= POINTS:
        return ""
    held = ("is a header but no point", "is one point", f"are {points} points")[min(points, 2)]
    return f"there {held} (at least {POINTS} rows of data are needed)"


def _adhesion_fault(slip: pd.Series, adhesion: pd.Series, speed: pd.Series | float) -> str:
    """A clause on why the adhesion cannot belong to the slip, [points]; empty if it can.

    Of a slow train the ratio of a noisy slip velocity is large: rows count by the velocity.
    """
    if (adhesion == 0).all():
        return "column adhesion is 0 in every row (no curve can be fitted to that)"
    product, size = slip * adhesion, adhesion.abs()
    # Where either is small, noise and an offset of the slip may turn a sign.
    slid = (slip * speed if slip.name == "slip_ratio" else slip).abs()
    clear = (slid > _ROLLING * slid.max()) & (size > _ROLLING * size.max())
    sides = {"positive": clear & (slip > 0), "negative": clear & (slip < 0)}
    apart = [
        f" where that is {sign}"
        for sign, side in sides.items()
        if side.sum() >= max(MOST * clear.sum(), POINTS) and product[side].sum() <= 0
    ]
    agree = product.sum() > 0
    if slip.min() == slip.max() or (agree and not apart):
        return ""
    fault = (
        f"column adhesion is mostly of the other sign than {slip.name}{apart[0] if agree else ''} "
        "(both are positive in traction and negative in braking)"
    )
    rolling = slip[size <= _ROLLING * size.max()].median()  # NaN without such rows
    if agree or slip.name != "slip_ratio" or not ((slip - rolling) * adhesion).sum() > 0:
        return fault
    return (
        f"{fault}; where there is little adhesion the slip is usually {rolling:.3g}, as where the "
        f"radius of the wheel is {percent(abs(rolling))} off: less that slip the signs agree; "
        "correct the wheel speed by it"
    )


def to_record(measured: Measured) -> Record:
    """Slip and adhesion of all points, and every numeric column as a condition."""
    table = measured.table
    conditions = {
        name: jnp.asarray(table[name].to_numpy(float))
        for name in table.columns.astype(str)
        if is_numeric_dtype(table[name].dtype)
    }
    if measured.slip == "slip_velocity_mps":
        # Falling friction multiplies the slip by the vehicle speed to get the slip velocity. Here
        # the slip is already that velocity, and a speed of 1 leaves it unchanged.
        conditions["vehicle_speed_mps"] = jnp.ones(len(table))
    every = jnp.ones(len(table), dtype=bool)
    return Record(conditions[measured.slip], conditions["adhesion"], every, every, conditions)
