"""From a file to a validated measured record."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import pandas as pd

from adhesion_jax.data.columns import COLUMNS, LABELS
from adhesion_jax.data.derived import SLOWEST, derive, needed
from adhesion_jax.data.files import Sheet, sheet_of_file, sheet_of_frame
from adhesion_jax.data.gathering import Gathered, gather
from adhesion_jax.data.schema import label_faults, range_faults, time_faults, unusual
from adhesion_jax.data.understanding import Taken, Understanding, understand
from adhesion_jax.errors import InputError
from adhesion_jax.records import Record
from adhesion_jax.runtime import silent
from adhesion_jax.wording import listed

#: A curve has up to five parameters; with fewer points its errors could not be estimated.
POINTS = 10

#: Rows with a gap in a column that is not needed are left out, up to this share of all rows.
_FEW = 0.05

Progress = Callable[[str, float], None]


class Measured(NamedTuple):
    """A validated table: SI units, one row a point, what could be derived added to it."""

    name: str  # the file it was read from
    table: pd.DataFrame  # its index holds the row numbers that a user sees there
    slip: str  # the column that is the slip: slip_ratio, or slip_velocity_mps without a speed
    covariates: tuple[str, ...]  # numeric columns that the project does not know
    left_out: tuple[str, ...]  # columns it does not know and that are not numbers throughout
    understood: pd.DataFrame  # a row a column: column, taken_as, unit, lowest, highest, missing
    notes: tuple[str, ...]  # sentences on how the file was read and which rows are not used


def read_measured(
    path: Path,
    columns: Mapping[str, object] | None = None,
    wheel_radius: float | None = None,
    progress: Progress = silent,
) -> Measured:
    """A measured table with slip and adhesion from a file; see `to_measured`.

    Read are .csv, .csv.gz, .txt, .tsv and .parquet. In text, cells are separated by commas,
    semicolons, tabs or bars, numbers have a decimal point or comma, and a row of units may stand
    under the header. `progress` is called with words and the share that is read.
    """
    return _measured(sheet_of_file(path), columns, wheel_radius, progress)


def to_measured(
    name: str,
    frame: pd.DataFrame,
    columns: Mapping[str, object] | None = None,
    wheel_radius: float | None = None,
) -> Measured:
    """A measured table with slip and adhesion, or InputError naming all that is wrong with it.

    Needed are slip_ratio, or what `derive` computes it from, and adhesion, or force and load of one
    body. Columns are taken for these by their names and units, or as `columns` says, see
    `mapping.said`. The other columns of COLUMNS and LABELS are checked where they are there;
    further numeric ones are kept as covariates. Rows with a gap in a column that is needed are left
    out, and so are those with a gap in another one as long as these are few; otherwise that column
    is left out. Whether the points are of use is for `check_curve` and `adhesion_faults` to say.
    """
    return _measured(sheet_of_frame(frame, name), columns, wheel_radius, silent)


def read_all(
    paths: Sequence[Path],
    columns: Mapping[str, object] | None = None,
    wheel_radius: float | None = None,
    progress: Progress = silent,
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
            files.append(read_measured(path, columns, wheel_radius, of_all))
        except InputError as error:
            faults.append(str(error).removesuffix("."))
    if faults:
        raise InputError(f"{'; '.join(faults)}.")
    return files


def _measured(
    sheet: Sheet,
    columns: Mapping[str, object] | None,
    wheel_radius: float | None,
    progress: Progress,
) -> Measured:
    found = understand(sheet, columns or {})
    names = {one.name for one in found.taken} | {*found.constants}
    names_needed, missing = needed(dict.fromkeys(names))
    if missing:
        raise InputError(f"{sheet.name} cannot be used: {_asked(sheet, found, missing)}.")
    read = gather(sheet, found.taken, progress)
    numbers, labels = read.numbers, read.labels
    taken = {one.name: one for one in found.taken if one.name in numbers}
    rows = read.rows
    row_of = range(sheet.first_row, sheet.first_row + rows)
    faults = [*([] if rows else [too_few(0)]), *read.faults, *range_faults(numbers, taken, row_of)]
    if faults:
        raise InputError(f"{sheet.name} cannot be used: {'; '.join(faults)}.")
    understood = [_understood(one, numbers) for one in found.taken if one.name in numbers]
    understood += [_understood(one, {}) for one in found.taken if one.name in labels]
    kept, gappy, notes = _without_gaps(numbers, [name for name in names_needed if name in numbers])
    for name, value in found.constants.items():
        numbers[name] = np.full(rows, value)
        understood.append(("constant", name, COLUMNS[name].unit, value, value, 0.0))
    if not kept.any():
        raise InputError(
            f"{sheet.name} cannot be used: no row has a value in {listed(names_needed)}."
        )
    if not kept.all():
        _keep(numbers, kept)
    try:
        derived = derive(numbers, wheel_radius)
    except InputError as error:
        raise InputError(f"{sheet.name} cannot be used: {error}.") from None
    notes += derived.notes
    moving = derived.used
    if not moving.all():
        _keep(numbers, moving)
        notes.append(
            f"In {_share(~moving)} the train is slower than {SLOWEST:g} m/s, where no slip ratio "
            "can be computed: these rows are not used."
        )
        if not moving.any():
            raise InputError(
                f"{sheet.name} cannot be used: the train speed is below {SLOWEST:g} m/s in every "
                "row, where no slip ratio can be computed (check its unit)."
            )
        kept[kept] = moving
    index = pd.Index(row_of if kept.all() else np.flatnonzero(kept) + sheet.first_row)
    table = pd.DataFrame(numbers, index=index, copy=False)
    for name, text in labels.items():
        table[name] = text[kept].set_axis(index)
    time = taken["time_s"].column if "time_s" in taken else "time_s"
    faults = [
        *range_faults({name: numbers[name] for name in derived.sources}, {}, index.to_numpy()),
        *label_faults({name: table[name] for name in labels}),
        *time_faults(table, time),
    ]
    if faults:
        raise InputError(f"{sheet.name} cannot be used: {'; '.join(faults)}.")
    for name, source in derived.sources.items():
        if name in numbers:
            lowest, highest = numbers[name].min(), numbers[name].max()
            understood.append(
                (f"computed: {source}", name, COLUMNS[name].unit, lowest, highest, 0.0)
            )
    return Measured(
        sheet.name,
        table,
        "slip_ratio" if "slip_ratio" in table else "slip_velocity_mps",
        tuple(name for name in numbers if name not in COLUMNS),
        (*read.left_out, *gappy),
        pd.DataFrame(understood, columns=[*_UNDERSTOOD]),
        (*_format_notes(sheet, found, read), *notes, *unusual(numbers, taken)),
    )


_UNDERSTOOD = ("column", "taken_as", "unit", "lowest", "highest", "missing")


def _understood(one: Taken, numbers: Mapping[str, np.ndarray]) -> tuple[object, ...]:
    """A row of the table of what was understood; the range is in the unit of the package."""
    values = numbers.get(one.name)
    if values is None:
        return one.column, one.name, "", np.nan, np.nan, 0.0
    known = np.isfinite(values)
    lowest = np.min(values, where=known, initial=np.inf) if known.any() else np.nan
    highest = np.max(values, where=known, initial=-np.inf) if known.any() else np.nan
    return one.column, one.name, one.stamp or one.unit, lowest, highest, (~known).mean()


def _without_gaps(
    numbers: dict[str, np.ndarray], names_needed: Sequence[str]
) -> tuple[np.ndarray, list[str], list[str]]:
    """The rows that are kept, the columns left out (they are removed), and sentences on both.

    Blank rows at the end are no rows.
    """
    rows = next(iter(numbers.values())).size
    missing = {name: np.isnan(numbers[name]) for name in numbers}
    kept = np.ones(rows, bool)
    notes: list[str] = []
    for name in names_needed:
        kept &= ~missing[name]
    blank = np.logical_and.reduce([*missing.values()])
    within = rows - int(blank[::-1].argmin()) if not blank.all() else 0
    lost = ~kept[:within]
    if lost.any():
        holes = [name for name in names_needed if missing[name][:within].any()]
        notes.append(
            f"In {_share(lost)} there is no value of {listed(holes, 'or')}: these are not used."
        )
    gappy: list[str] = []
    further = sorted(
        (name for name in numbers if name not in names_needed), key=lambda one: missing[one].sum()
    )
    allowed = _FEW * kept.sum()
    dropped = 0
    few: list[str] = []
    for name in further:
        more = kept & missing[name]
        if not more.any():
            continue
        if dropped + more.sum() <= allowed:
            dropped += int(more.sum())
            kept &= ~more
            few.append(name)
        else:
            share = missing[name][:within].mean()
            gappy.append(name)
            del numbers[name]
            notes.append(
                f"The column {name} is left out: {100 * share:.3g} % of its rows have no value."
            )
    if few:
        notes.append(
            f"In {dropped:,} rows there is no value of {listed(few, 'or')}: these are not used."
        )
    return kept, gappy, notes


def _keep(columns: dict[str, np.ndarray], rows: np.ndarray) -> None:
    """Keeps some of the rows, in place: two copies of the columns of a log do not fit in memory."""
    for name in columns:
        columns[name] = columns[name][rows]


def _share(rows: np.ndarray) -> str:
    count = int(rows.sum())
    words = "1 row" if count == 1 else f"{count:,} rows"
    return f"{words} of {rows.size:,} ({100 * rows.mean():.3g} %)"


def _asked(sheet: Sheet, found: Understanding, missing: Sequence[str]) -> str:
    """Clauses on what is missing, or what must be told of the columns in its place."""
    asked = [one.clause for one in found.questions if {*one.quantities} & _OF_USE]
    there = ", ".join(sheet.columns[:12]) or "no column"
    more = " ..." if len(sheet.columns) > 12 else ""
    clauses = [*missing]
    clauses[-1] += f" (there are {there}{more})"
    if asked:
        clauses.append(f"please say {'; '.join(asked)}")
    return "; ".join(clauses)


#: Quantities from which slip and adhesion come.
_OF_USE = {
    "slip_ratio",
    "slip_velocity_mps",
    "wheel_speed_mps",
    "wheel_rotation_radps",
    "vehicle_speed_mps",
    "adhesion",
    "tangential_force_N",
    "axle_force_N",
    "locomotive_force_N",
    "normal_load_N",
    "axle_load_N",
    "locomotive_load_N",
}


def _format_notes(sheet: Sheet, found: Understanding, read: Gathered) -> list[str]:
    notes = [f"The file has {sheet.format}."] if sheet.format else []
    if read.origin:
        notes.append(f"The time counts from {read.origin}.")
    notes += [f"The column {name} is left out: {why}." for name, why in read.left_out.items()]
    notes += [
        f"The column {name} is left out: it may be a force, which is what the adhesion explains."
        for name in found.left_out
    ]
    notes += [
        f"The column {one.column} keeps its name: it is not known {one.clause}."
        for one in found.questions
        if one.column not in found.left_out
    ]
    return notes


def check_curve(measured: Measured) -> None:
    """Raises InputError if no curve can be identified although every cell is valid."""
    slip = measured.table[measured.slip]
    different = slip.abs().nunique()
    if len(slip) < POINTS:
        faults: Sequence[str] = [too_few(len(slip))]
    elif different < POINTS // 2:
        faults = [
            f"column {slip.name} has only {different} different sizes of slip "
            f"(a curve needs at least {POINTS // 2})"
        ]
    else:
        faults = adhesion_faults(slip, measured.table["adhesion"])
    if faults:
        raise InputError(f"{measured.name} cannot be used: {'; '.join(faults)}.")


def adhesion_faults(slip: pd.Series, adhesion: pd.Series) -> Sequence[str]:
    """Sentences on why the adhesion cannot belong to the slip, both [points]; none if it can."""
    if (adhesion == 0).all():
        return ["column adhesion is 0 in every row (no curve can be fitted to that)"]
    if slip.min() < slip.max() and (slip * adhesion).sum() <= 0:
        return [
            f"column adhesion is mostly of the other sign than {slip.name} "
            "(both are positive in traction and negative in braking)"
        ]
    return []


def too_few(points: int) -> str:
    """The fault of a table that has fewer than POINTS points."""
    held = {0: "there is a header but no point", 1: "there is one point"}.get(
        points, f"there are {points} points"
    )
    return f"{held} (at least {POINTS} rows of data are needed)"


def to_record(measured: Measured) -> Record:
    """Slip and adhesion of all points, and every numeric column as a condition."""
    table = measured.table
    conditions = {
        name: jnp.asarray(table[name].to_numpy(float))
        for name in table.columns.astype(str)
        if name not in LABELS
    }
    if measured.slip == "slip_velocity_mps":
        # Falling friction multiplies the slip by the vehicle speed to get the slip velocity. Here
        # the slip is already that velocity, and a speed of 1 leaves it unchanged.
        conditions["vehicle_speed_mps"] = jnp.ones(len(table))
    every = jnp.ones(len(table), dtype=bool)
    return Record(conditions[measured.slip], conditions["adhesion"], every, every, conditions)
