"""Files, and folders of them, as sheets of cells: what is in them, and their cells in blocks."""

import glob
import gzip
import io
import itertools
import os
import re
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from io import BufferedIOBase
from pathlib import Path
from typing import NamedTuple

import pandas as pd
import pyarrow
import pyarrow.compute
import pyarrow.csv
import pyarrow.parquet

from adhesion_jax.data.cells import (
    A_DATE,
    AND_TIME,
    CLOCKS,
    EITHER,
    MISSING_LABEL,
    ORDERS,
    TIME_OF_DAY,
    WITH_ZONE,
    form_of,
    is_text,
    known,
)
from adhesion_jax.data.containers import FRAMED, SPREADSHEETS, spreadsheet, zipped
from adhesion_jax.data.dialect import Dialect, Tabbed, dialect_of, encoding_of, ragged, tidy
from adhesion_jax.errors import InputError
from adhesion_jax.wording import listed

_OF_TEXT = (".csv", ".csv.gz", ".txt", ".tsv", ".dat", ".asc")
ENDINGS = (*_OF_TEXT, ".zip", *SPREADSHEETS, ".parquet", *FRAMED)
_KINDS = f"a {listed(ENDINGS, 'or')} file"

#: What is to be named where nothing can be read.
WANTED = "name a file of measurements, or a folder or a pattern of such files"

#: Names that pandas gives to an index that was saved as a column.
_SAVED_INDEX = re.compile(r"|Unnamed: \d+|__index_level_\d+__")

#: Bytes of text, and rows of other tables, that are read at a time.
_BLOCK_BYTES = 1 << 23
_BLOCK_ROWS = 1 << 17

#: Bytes of each column of a parquet file that are read at a time.
_STREAM_BYTES = 1 << 20

#: How many cells of a column of text show whether it holds stamps.
_SHOWN = 200

#: The column that says of which file a row is.
_FILE = "file"

#: Cells of some rows by the name of their column, all of one length.
Block = Mapping[str, pyarrow.Array]


#: Opens text as bytes, and the file whose place tells how much is read.
_Opened = Callable[[], AbstractContextManager[tuple[BufferedIOBase, BufferedIOBase]]]


class Sheet(NamedTuple):
    """A table of cells, of which nothing but the beginning has been read."""

    name: str
    columns: tuple[str, ...]  # without those that have no name, such as a saved index
    units: Mapping[str, str]  # what stands in a row of units, by column; empty without one
    stamps: Mapping[str, str]  # columns of dates or times of day, and their form
    first_row: int  # the number that a user sees of the first row of data
    mark: str | None  # decimal mark of the numbers written as text, where it is known
    format: str  # a sentence on how the file is written; empty for a data frame
    blocks: Callable[[], Iterator[tuple[Block, float]]]  # with the share that is read

    def head(self) -> "Sheet":
        """The same with its first block alone."""
        return self._replace(blocks=lambda: itertools.islice(self.blocks(), 1))


def sheet_of(path: Path) -> Sheet:
    """A file as a sheet; or all files of a folder or of a pattern, one below the other.

    They are in the order of their names, run 2 before run 10, and a column `file` tells them apart.
    InputError where their columns do not agree.
    """
    is_folder = os.path.isdir(path)
    if not is_folder and (os.path.exists(path) or not glob.has_magic(str(path))):
        return sheet_of_file(path)
    found = glob.glob(f"{glob.escape(str(path))}/*" if is_folder else str(path))
    paths = [Path(one) for one in found if one.lower().endswith(ENDINGS) and os.path.isfile(one)]
    # So begins the name of what Excel puts beside a workbook that is open.
    paths = [one for one in paths if not one.name.startswith("~$")]
    if not paths:
        raise InputError(f"{path} has no file that can be read; {WANTED}.")
    paths.sort(key=_in_order)
    sheets = [sheet_of_file(one) for one in paths]
    return sheets[0] if len(sheets) == 1 else _one_below_the_other(path, paths, sheets)


def _in_order(path: Path) -> list[tuple[int, str]]:
    """A name as texts and numbers."""
    return [
        (int(one), "") if one.isdecimal() else (0, one) for one in re.split(r"(\d+)", f"{path}")
    ]


def _one_below_the_other(path: Path, paths: Sequence[Path], sheets: Sequence[Sheet]) -> Sheet:
    # An order of day and month that one file shows is that of the others that leave it open.
    decided = {
        (name, form.replace(order, EITHER)): form
        for one in sheets
        for name, form in one.stamps.items()
        for order in ORDERS
        if form.startswith(order) and not form.startswith(EITHER)
    }
    sheets = [
        one._replace(stamps={key[0]: decided.get(key, key[1]) for key in one.stamps.items()})
        for one in sheets
    ]
    first = sheets[0]
    for other in sheets[1:]:
        apart = sorted({*first.columns} ^ {*other.columns})
        if apart:
            reason = f"one of them alone has {listed(apart[:5])}{' ...' if apart[5:] else ''}"
        elif first.units != other.units:
            reason = "their rows of units differ"
        elif first.stamps != other.stamps:
            reason = "they write dates in different forms"
        elif {first.mark, other.mark} == {".", ","}:
            reason = "one has decimal points and the other decimal commas"
        else:
            continue
        raise InputError(
            f"{path} is not one log: the columns of {first.name} and {other.name} do not agree "
            f"({reason}); name files of the same columns."
        )
    above = os.path.commonpath([one.parent for one in paths])
    names = [Path(os.path.relpath(one, above)).as_posix() for one in paths]

    def blocks() -> Iterator[tuple[Block, float]]:
        for place, sheet in enumerate(sheets):
            for block, share in sheet.blocks():
                own = pyarrow.repeat(names[place], len(next(iter(block.values()), ())))
                # A column of that name which the files have themselves stays theirs.
                yield {_FILE: own, **block}, (place + share) / len(sheets)

    return first._replace(
        name=str(path),
        columns=tuple(dict.fromkeys((*first.columns, _FILE))),
        mark=next((one.mark for one in sheets if one.mark), None),
        format=f"{len(sheets)} parts, {paths[0].name} to {paths[-1].name}, whose rows are counted "
        f"one after the other{f', and {first.format}' if first.format else ''}",
        blocks=blocks,
    )


def sheet_of_file(path: Path) -> Sheet:
    """A file as a sheet; InputError where it cannot be read, is empty, or is not a table."""
    try:
        if not path.is_file():
            problem = "is not a file" if path.exists() else "does not exist"
            raise InputError(f"{path} {problem}; {WANTED}.")
        name = path.name.lower()
        if not name.endswith(ENDINGS):
            raise InputError(f"the ending of {path} is not known; name {_KINDS}.")
        if not path.stat().st_size:
            raise InputError(f"{path} is empty; it needs a header and one row a point.")
        if name.endswith(".parquet"):
            return _parquet(path)
        ending = path.suffix.lower()
        if ending in FRAMED:
            frame, said = FRAMED[ending](path)
            return sheet_of_frame(frame, str(path))._replace(format=said, first_row=1)
        if ending in SPREADSHEETS:
            text, sheet = spreadsheet(path)
            found = _text(path, lambda: nullcontext((held := io.BytesIO(text), held)))
            # Of how the text is written the user wants to know what the sheet has itself.
            said = ", ".join([f"the sheet {tidy(sheet)}", *found.format.split(", ")[1:]])
            return found._replace(format=said)
        return _text(path, lambda: _opened(path))
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}); {WANTED}.") from None


def sheet_of_frame(frame: pd.DataFrame, name: str) -> Sheet:
    """A data frame as if read from a file; rows count from 0, as by `frame.iloc`.

    An index that has a name, or holds times, is a column.
    """
    index = frame.index
    of_times = isinstance(index, pd.DatetimeIndex | pd.TimedeltaIndex)
    if of_times or {*index.names} - {None, *frame.columns}:
        frame = frame.reset_index(allow_duplicates=True)
    written = [_arrow(frame.iloc[:, place]) for place in range(frame.shape[1])]
    places = _named(name, [str(column) for column in frame.columns], written)
    cells = {column: written[place] for column, place in places.items()}
    return Sheet(name, tuple(cells), {}, _stamps(cells), 0, None, "", lambda: iter([(cells, 1.0)]))


def _arrow(column: pd.Series) -> pyarrow.Array:
    try:
        values = pyarrow.array(column, from_pandas=True)
    except (pyarrow.ArrowInvalid, pyarrow.ArrowTypeError, pyarrow.ArrowNotImplementedError):
        text = column.astype(object).where(column.notna(), "").astype(str)
        values = pyarrow.array(text, pyarrow.string(), from_pandas=True)
    return values.combine_chunks() if isinstance(values, pyarrow.ChunkedArray) else values


def _parquet(path: Path) -> Sheet:
    with _whole_parquet(path):
        # Read as a stream: by default the whole file is in memory until its last row is read.
        file = pyarrow.parquet.ParquetFile(path, buffer_size=_STREAM_BYTES, pre_buffer=False)
        schema = file.schema_arrow
        first = next(file.iter_batches(_SHOWN), None)
        first = first or pyarrow.RecordBatch.from_pylist([], schema)
        first.validate(full=True)
        places = _named(str(path), schema.names, first.columns)
        written = {name: schema.names[place] for name, place in places.items()}
        stamps = _stamps({name: first.column(column) for name, column in written.items()})

    def decoded(cells: pyarrow.Array) -> pyarrow.Array:
        return cells.dictionary_decode() if pyarrow.types.is_dictionary(cells.type) else cells

    def blocks() -> Iterator[tuple[Block, float]]:
        done = 0
        with _whole_parquet(path):
            for batch in file.iter_batches(_BLOCK_ROWS, columns=[*written.values()]):
                batch.validate(full=True)
                done += batch.num_rows
                cells = {name: decoded(batch.column(column)) for name, column in written.items()}
                yield cells, done / max(file.metadata.num_rows, 1)

    return Sheet(str(path), tuple(written), {}, stamps, 1, None, "", blocks)


@contextmanager
def _whole_parquet(path: Path) -> Iterator[None]:
    try:
        yield
    except (pyarrow.ArrowException, OSError, UnicodeDecodeError):
        raise InputError(f"{path} is not a whole parquet file; write it anew.") from None


def _text(path: Path, opened: _Opened) -> Sheet:
    with opened() as (stream, _):
        encoding = encoding_of(stream, str(path))
    with opened() as (stream, _):
        dialect = dialect_of(stream, encoding, str(path))
    rows = dialect.rows[:_SHOWN]
    shown = [pyarrow.array([row[at] for row in rows]) for at in range(len(dialect.names))]
    places = _named(str(path), dialect.names, shown)
    return Sheet(
        str(path),
        tuple(places),
        {name: dialect.units[place] for name, place in places.items()} if dialect.units else {},
        _stamps({name: shown[place] for name, place in places.items()}),
        dialect.above + 1,
        dialect.mark,
        dialect.sentence,
        lambda: _text_blocks(path, opened, dialect, places),
    )


def _text_blocks(
    path: Path, opened: _Opened, dialect: Dialect, places: Mapping[str, int]
) -> Iterator[tuple[Block, float]]:
    invalid: list[pyarrow.csv.InvalidRow] = []

    def note(row: pyarrow.csv.InvalidRow) -> str:
        if len(invalid) < 2:
            invalid.append(row)
        return "skip"

    keys = [str(place) for place in range(len(dialect.names))]
    above = dialect.above - dialect.skipped
    size = max(path.stat().st_size, 1)
    spaced = dialect.separator == " "
    with opened() as (stream, raw):
        try:
            reader = pyarrow.csv.open_csv(
                pyarrow.PythonFile(io.BufferedReader(Tabbed(stream)) if spaced else stream, "r"),
                pyarrow.csv.ReadOptions(
                    column_names=keys,
                    skip_rows=dialect.skipped,
                    use_threads=False,  # with threads the rows of faults have no numbers
                    block_size=_BLOCK_BYTES,
                    encoding=dialect.encoding.removesuffix("-sig"),
                ),
                pyarrow.csv.ParseOptions(
                    delimiter="\t" if spaced else dialect.separator,
                    newlines_in_values=dialect.quoted,
                    ignore_empty_lines=False,
                    invalid_row_handler=note,
                ),
                pyarrow.csv.ConvertOptions(
                    column_types=dict.fromkeys(keys, pyarrow.string()),
                    include_columns=[keys[place] for place in places.values()],
                    null_values=list(MISSING_LABEL),
                    strings_can_be_null=True,
                ),
            )
            for batch in reader:
                if invalid:
                    break
                head, above = above, max(above - batch.num_rows, 0)
                batch = batch.slice(head)
                if batch.num_rows:
                    cells = dict(zip(places, batch.columns, strict=True))
                    yield cells, min(raw.tell() / size, 1.0)
        except pyarrow.ArrowInvalid as error:
            if not invalid:
                raise InputError(
                    f"{path} is not a table of text ({str(error).splitlines()[0]}); save it anew "
                    "as comma-separated UTF-8 text."
                ) from None
    if invalid:
        raise ragged(path, dialect, invalid)


@contextmanager
def _opened(path: Path) -> Iterator[tuple[BufferedIOBase, BufferedIOBase]]:
    """The text of a file as bytes, and the file itself, whose place tells how much is read."""
    with path.open("rb") as raw:
        match path.suffix.lower():
            case ".zip":
                opened, broken = zipped(path, _OF_TEXT), "zip file; zip it"
            case ".gz":
                opened, broken = gzip.GzipFile(fileobj=raw), "gzip file; compress it"
            case _:
                yield raw, raw
                return
        try:
            with opened as stream:
                yield stream, raw
        except (gzip.BadGzipFile, EOFError, zlib.error, zipfile.BadZipFile):
            raise InputError(f"{path} is not a whole {broken} anew.") from None


def _named(path: str, written: Sequence[str], columns: Sequence[pyarrow.Array]) -> dict[str, int]:
    """The names that are more than those of a saved index without times, and their places."""
    stamps = _stamps({str(place): cells for place, cells in enumerate(columns)})
    names = [
        "index" if str(place) in stamps and _SAVED_INDEX.fullmatch(name) else name
        for place, name in enumerate(map(tidy, written))
    ]
    twice = next((name for name in names if name and names.count(name) > 1), None)
    if twice is not None:
        raise InputError(f"{path} has the column {twice} twice; give every column its own name.")
    return {name: place for place, name in enumerate(names) if not _SAVED_INDEX.fullmatch(name)}


def _stamps(columns: Block) -> dict[str, str]:
    """The columns whose first cells are dates or times of day, and the form of these."""
    found = {}
    for name, cells in columns.items():
        kind = cells.type
        if pyarrow.types.is_timestamp(kind):
            found[name] = A_DATE + (WITH_ZONE if kind.tz else "") + AND_TIME
        elif pyarrow.types.is_time(kind) or pyarrow.types.is_duration(kind):
            found[name] = TIME_OF_DAY
        elif pyarrow.types.is_date(kind):
            found[name] = A_DATE
        elif is_text(kind):
            found[name] = form_of([cell or "" for cell in cells[:_SHOWN].to_pylist()])
    return {name: form for name, form in found.items() if form}


def with_dates_joined(sheet: Sheet) -> Sheet:
    """A sheet in which a column of dates and the one column of times of day are one, of both names.

    Dates that are not joined are no stamps: a day alone does not tell the time.
    """
    clocks = [name for name, form in sheet.stamps.items() if form == TIME_OF_DAY]
    dates = [
        name
        for name, form in sheet.stamps.items()
        if form not in CLOCKS and not form.endswith(AND_TIME)
    ]
    stamps = {name: form for name, form in sheet.stamps.items() if name not in dates}
    if len(dates) != 1 or len(clocks) != 1 or f"{dates[0]} {clocks[0]}" in sheet.columns:
        return sheet._replace(stamps=stamps)
    date, clock = dates[0], clocks[0]
    both = f"{date} {clock}"
    del stamps[clock]
    stamps[both] = sheet.stamps[date] + AND_TIME

    def blocks() -> Iterator[tuple[Block, float]]:
        for block, share in sheet.blocks():
            cells = dict(block)
            parts = (cells.pop(name).cast(pyarrow.string()) for name in (date, clock))
            trimmed = map(known, map(pyarrow.compute.utf8_trim_whitespace, parts))
            cells[both] = pyarrow.compute.binary_join_element_wise(*trimmed, " ")
            yield cells, share

    columns = tuple(both if name == date else name for name in sheet.columns if name != clock)
    return sheet._replace(columns=columns, stamps=stamps, blocks=blocks)
