"""The cells of a sheet as columns of numbers and labels; repeats and axles side by side as rows."""

from collections.abc import Callable, Sequence

import numpy as np
import pandas as pd
import pyarrow
import pyarrow.compute

from adhesion_jax.data.cells import (
    CLOCKS,
    OF_TWO_MEANINGS,
    WITH_ZONE,
    decimal_mark,
    flags,
    is_text,
    numbers,
    seconds,
    stamps,
    unwrapped,
)
from adhesion_jax.data.columns import COLUMNS, FLAGS, LABELS
from adhesion_jax.data.files import Block, Sheet
from adhesion_jax.data.rows import MOST, Rows
from adhesion_jax.data.understanding import Taken
from adhesion_jax.errors import InputError
from adhesion_jax.wording import listed, number

#: How many numbers with a mark show whether it is decimal.
_SHOWN = 1000

#: A column of text with more different entries than this is none of labels.
_MOST_LABELS = 40

#: Numbers beyond this size cannot be squared and summed.
_LARGEST = 1e100


class _Column:
    """The values of a column in one array that grows: what is not filled takes no memory."""

    def __init__(self) -> None:
        self._room, self._filled = np.empty(0), 0

    def append(self, values: np.ndarray) -> None:
        end = self._filled + values.size
        if end > self._room.size:
            room = np.empty(max(end, 2 * self._room.size))
            room[: self._filled] = self.values
            self._room = room
        self._room[self._filled : end] = values
        self._filled = end

    @property
    def values(self) -> np.ndarray:
        return self._room[: self._filled]


def gather(sheet: Sheet, taken: Sequence[Taken], progress: Callable[[str, float], None]) -> Rows:
    """Reads all cells of the columns that are taken; `progress` is told the share of the file."""
    columns = {one.name: _Column() for one in taken if one.name not in LABELS}
    labels: dict[str, list[pyarrow.Array]] = {n.name: [] for n in taken if n.name in LABELS}
    texts: dict[str, tuple[int, str]] = {}
    origin: int | None = None
    mark, first_row = sheet.mark, sheet.first_row
    own: dict[str, str | None] = {}  # the mark by column, which may not be that of the file
    for block, share in sheet.blocks():
        own = own or {one.name: _shown(block[one.column]) for one in taken if one.name in columns}
        if mark is None:
            mark = _mark(sheet, taken, block, first_row)
        for one in taken:
            cells = block[one.column]
            if one.name in labels:
                of_rows = _labels(cells)
                if of_rows is None:
                    raise InputError(
                        f"{sheet.name} cannot be used: the column {one.column} holds no numbers "
                        "and no text, which labels are (write a text or a number in each cell)."
                    )
                labels[one.name].append(of_rows)
                continue
            if one.stamp:
                ticks, text = stamps(cells, one.stamp)
                if origin is None:
                    origin = 0 if one.stamp in CLOCKS else pyarrow.compute.min(ticks).as_py()
                values = seconds(ticks, origin or 0)
            else:
                written = flags(cells) if one.quantity in FLAGS else cells
                values, text = numbers(written, own.get(one.name) or mark or ".")
                with np.errstate(over="ignore"):  # it is infinite then, and not used
                    values = one.conversion.of(values)
            of_labels = text.size > MOST * (text.size + np.isfinite(values).sum())
            if of_labels and one.quantity not in COLUMNS and first_row == sheet.first_row:
                of_rows = _labels(cells)
                if of_rows is not None:
                    del columns[one.name]
                    labels[one.name] = [of_rows]
                    continue
            if text.size:
                place = int(text[0])
                first = _text_fault(first_row + place, one.column, cells[place].as_py())
                count, first = texts.get(one.name, (0, first))
                texts[one.name] = count + text.size, first
            columns[one.name].append(values)
        first_row += len(next(iter(block.values()), ()))
        # Of a long log it would hold hundreds of megabytes that nobody uses.
        pyarrow.default_memory_pool().release_unused()
        progress("reading", share)
    dated = any(one.stamp not in ("", *CLOCKS) for one in taken)
    zone = " UTC" if any(WITH_ZONE in one.stamp for one in taken) else ""
    found, named = {name: column.values for name, column in columns.items()}, {}
    for name, blocks in labels.items():
        kind = pyarrow.dictionary(pyarrow.int32(), pyarrow.string())
        whole = pyarrow.chunked_array(blocks, kind).unify_dictionaries().combine_chunks()
        names = pd.Index(whole.dictionary.to_pylist(), dtype="str")
        named[name] = pd.Categorical.from_codes(whole.indices.to_numpy(), names)
    for one in taken:
        if one.stamp in CLOCKS:  # it goes on past midnight, or the full hour
            found[one.name] = unwrapped(found[one.name], CLOCKS[one.stamp])
    left_out = {one.name: _unfit(one, found[one.name]) for one in taken if one.name in found}
    left_out |= {
        name: f"it has {len(of.categories)} different texts, and labels are at most {_MOST_LABELS}"
        for name, of in named.items()
        if name not in LABELS and len(of.categories) > _MOST_LABELS
    }
    left_out = {name: reason for name, reason in left_out.items() if reason}
    return Rows(
        {name: values for name, values in found.items() if name not in left_out},
        {name: label for name, label in named.items() if name not in left_out},
        pd.RangeIndex(sheet.first_row, first_row),
        texts,
        left_out,
        f"{pd.Timestamp(origin)}{zone}" if dated and origin is not None else "",
    )


def _text_fault(row: int, column: str, written: object) -> str:
    """What is said of a cell that is text where a number belongs."""
    if str(written).strip() == column:
        return f"row {row} is the header again (leave that row out)"
    return (
        f"row {row} of column {column} has the text '{' '.join(str(written).split()):.30}' (write "
        "a number, with a decimal point, no unit)"
    )


def _mark(sheet: Sheet, taken: Sequence[Taken], block: Block, first_row: int) -> str | None:
    """The decimal mark as a block shows it, where the first rows of the file show none."""
    found, compute = None, pyarrow.compute
    for one in taken:
        cells = block[one.column]
        if one.name in LABELS or one.stamp or not is_text(cells.type):
            continue
        either = compute.index(compute.match_substring_regex(cells, OF_TWO_MEANINGS), True).as_py()
        found = found or _shown(cells)
        if found is None and either >= 0:
            written = cells[either].as_py()
            raise InputError(
                f"{sheet.name} cannot be used: row {first_row + either} of column {one.column} has "
                f"{written}, which may be {written.replace(',', '.', 1)} or "
                f"{written.replace(',', '')} (write a decimal point, and no marks of thousands)."
            )
    return found


def _shown(cells: pyarrow.Array) -> str | None:
    """The decimal mark that the cells of a column show."""
    if not is_text(cells.type):
        return None
    marked = cells.filter(pyarrow.compute.match_substring_regex(cells, "[.,]"))
    return decimal_mark(marked.slice(0, _SHOWN).to_pylist())


def _labels(cells: pyarrow.Array) -> pyarrow.Array | None:
    """Labels as text, empty where there is none; None where cells are lists, bytes and the like."""
    compute = pyarrow.compute
    if pyarrow.types.is_floating(cells.type):
        # Whole numbers may be written as 1.0 in one file and as 1 in another.
        cells = compute.if_else(compute.is_nan(cells), pyarrow.scalar(None, cells.type), cells)
        known = cells.drop_null()
        whole = compute.equal(compute.floor(known), known)
        if compute.all(compute.and_(whole, compute.less(compute.abs(known), 2.0**53))).as_py():
            cells = cells.cast(pyarrow.int64())
    try:
        text = cells.cast(pyarrow.string())
    except (pyarrow.ArrowNotImplementedError, pyarrow.ArrowInvalid):
        return None
    return compute.utf8_trim_whitespace(compute.fill_null(text, "")).dictionary_encode()


def _unfit(one: Taken, values: np.ndarray) -> str:
    """Why a further column of numbers is not used, as a clause; empty where it is."""
    if one.quantity in COLUMNS:
        return ""
    size = np.abs(values)
    largest = np.max(size, where=np.isfinite(size), initial=0.0)
    if largest > _LARGEST or 0.0 < largest < 1.0 / _LARGEST:
        return f"its largest value is {largest:.3g}, of which no sum of squares can be computed"
    return ""


#: Slips whose variances are pooled: of three repeats a variance is known to a factor of two only.
_POOLED = 5

#: What repeats differ in: the adhesion, what it comes from, and the label of the repeat itself.
_REPEATED = ("adhesion", "tangential_force_N", "run")


def stack(rows: Rows, taken: Sequence[Taken], label: str) -> list[str]:
    """Puts every repeat or axle below the other, where they are columns side by side; a sentence.

    The `label` numbers the copies from 1; where the file has such labels it is `label/copy`. What
    has one column for all is repeated. Without a label all stays as it is.
    """
    if not label:
        return []
    copies: dict[str, list[str]] = {}
    for one in taken:
        if one.copy:
            copies.setdefault(one.quantity, []).append(one.name)
    count, before = max(map(len, copies.values())), rows.numbers
    names = {name for of_one in copies.values() for name in of_one}
    rows.numbers = {
        name: np.tile(values, count) for name, values in before.items() if name not in names
    }
    for quantity, of_one in copies.items():
        if all(name in before for name in of_one):  # of one that is not needed, one may lack
            rows.numbers[quantity] = np.concatenate([before[name] for name in of_one])
    labels = {
        name: pd.Categorical.from_codes(np.tile(of.codes, count), of.categories)
        for name, of in rows.labels.items()
    }
    number = np.repeat(np.arange(1, count + 1), rows.count).astype(str)
    if label in labels:
        number = np.char.add(np.char.add(np.asarray(labels[label], str), "/"), number)
    rows.labels = {**labels, label: pd.Categorical(number.astype(object))}
    rows.index = pd.Index(np.tile(rows.index, count))
    side_by_side, used = listed([one.column for one in taken if one.copy]), f"{rows.count:,} rows"
    if label == "axle":
        return [
            f"The columns {side_by_side} are those of {count} axles: they are used as {used}, one "
            "axle below the other."
        ]
    return [
        f"The columns {side_by_side} are {count} repeats of the adhesion: they are used as {used}, "
        "those of the first column being run 1, and so on."
    ]


def of_means(rows: Rows) -> None:
    """Makes the standard deviation that of the mean where repeats are counted.

    The standard deviation of the mean of n repeats is that of one over the root of n. A number of
    repeats explains nothing of the adhesion, and is not handed on.
    """
    count = rows.numbers.pop("repeats", None)
    if count is None:
        return
    if "adhesion_sd" not in rows.numbers:
        rows.notes.append(
            "The number of repeats is not used: there is no standard deviation of the adhesion."
        )
        return
    rows.numbers["adhesion_sd"] = rows.numbers["adhesion_sd"] / np.sqrt(count)
    rows.notes.append(
        "Each adhesion is the mean of its number of repeats: its standard deviation is that of the "
        "file over the root of that number."
    )


def with_scatter(table: pd.DataFrame, slip: str) -> tuple[pd.DataFrame, list[str]]:
    """The table with the column adhesion_sd from its repeats, and the sentence that says so.

    The standard deviation of one row is

        sqrt(sum of squared deviations from the mean of the repeats / sum of (repeats - 1))

    both summed over 5 neighbouring slips. Repeats are rows of exactly the same slip and the same
    other numbers, axle and mode. Unchanged are a table that has the column, one with time_s, whose
    rows are no repeats, and one in which half of the slips or fewer are repeated, or under 5.
    """
    if "adhesion_sd" in table or "time_s" in table or not len(table):
        return table, []
    slips, at, rows_at = np.unique(table[slip].to_numpy(), return_inverse=True, return_counts=True)
    if slips.size < _POOLED or 2 * np.count_nonzero(rows_at > 1) <= slips.size:
        return table, []
    same = [column for column in table if column not in _REPEATED]
    group = table.groupby(same, sort=False, observed=True).ngroup().to_numpy()
    adhesion, rows = table["adhesion"].to_numpy(), np.bincount(group)
    mean = np.bincount(group, adhesion) / rows
    squares = np.bincount(at, (adhesion - mean[group]) ** 2, slips.size)
    # Every group has one degree of freedom less than it has rows.
    freedom = np.bincount(at, 1 - 1 / rows[group], slips.size).round()
    repeated = np.flatnonzero(freedom)
    if repeated.size < _POOLED or 2 * repeated.size <= slips.size:
        return table, []
    first = np.clip(np.arange(repeated.size) - _POOLED // 2, 0, repeated.size - _POOLED)

    def pooled(values: np.ndarray) -> np.ndarray:
        whole = np.concatenate([[0.0], np.cumsum(values[repeated])])
        return whole[first + _POOLED] - whole[first]

    scatter = np.sqrt(pooled(squares) / pooled(freedom))
    # Adding up and taking away leaves rounding where repeats are equal throughout.
    if scatter.min() <= 1e-9:
        return table, []
    nearest = np.interp(np.arange(slips.size), repeated, np.arange(repeated.size)).round()
    column = scatter[nearest.astype(int)][at]
    note = (
        f"The standard deviation of the adhesion is that of the repeats, which {repeated.size} of "
        f"{slips.size} slips have: {number(column.min())} to {number(column.max())} in a row, each "
        f"from {_POOLED} neighbouring slips."
    )
    return table.assign(adhesion_sd=column), [note]
