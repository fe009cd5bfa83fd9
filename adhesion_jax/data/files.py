"""Reads a file as a table of cells, exactly as they are written."""

import csv
import gzip
import io
import re
import zlib
from collections.abc import Sequence
from pathlib import Path

import pandas as pd
import pyarrow
import pyarrow.parquet

from adhesion_jax.errors import InputError

_KINDS = "a .csv, .csv.gz or .parquet file"

#: Names that pandas gives to an index that was saved as a column.
_SAVED_INDEX = re.compile(r"|Unnamed: \d+|__index_level_\d+__")

#: Number of bytes that are read at a time to count rows.
_CHUNK = 1 << 22


def refuse_many_rows(paths: Sequence[Path], limit: int) -> None:
    """InputError where the files hold more than `limit` rows of data together.

    The rows are counted before anything is read into memory, and no further than the limit. What
    is not a file, or is damaged, is left for `read_table` to report.
    """
    total = 0
    for path in paths:
        try:
            total += _rows(path, limit - total)
        except (OSError, EOFError, zlib.error, pyarrow.ArrowException):
            continue
        if total > limit:
            raise too_many_rows(list(map(str, paths)), limit)


def too_many_rows(names: Sequence[str], limit: int) -> InputError:
    """What is said where tables of these names hold more rows than that together."""
    return InputError(
        f"{', '.join(names)} cannot be used: there are more than {limit:,} rows of data (thin "
        "them: keep some of the runs whole, or every k-th row of each run)."
    )


def _rows(path: Path, enough: int) -> int:
    """The number of rows of data of a file; counting stops once it exceeds `enough`."""
    name = path.name.lower()
    if name.endswith(".parquet"):
        rows: int = pyarrow.parquet.read_metadata(path).num_rows
        return rows
    ends, last = 0, b"\n"
    with gzip.open(path) if name.endswith(".gz") else path.open("rb") as stream:
        while ends <= enough + 1 and (chunk := stream.read(_CHUNK)):
            ends += chunk.count(b"\n")
            last = chunk[-1:]
    # The header is not counted; the last line of a file may lack its line break.
    return max(ends - 1 + (last != b"\n"), 0)


def read_table(path: Path) -> pd.DataFrame:
    """The cells of a file; its index holds the row numbers that a user sees there.

    Cells of a text file are text (the header is row 1), those of a parquet file have their own
    types (its first row is row 1). Columns without a name, such as a saved index, are left out.
    InputError where the file cannot be read, is empty, or is not a table.
    """
    if not path.is_file():
        problem = "is not a file" if path.exists() else "does not exist"
        raise InputError(f"{path} {problem}; name {_KINDS}.")
    name = path.name.lower()
    if not name.endswith((".csv", ".csv.gz", ".parquet")):
        raise InputError(f"the ending of {path} is not known; name {_KINDS}.")
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}); name {_KINDS}.") from None
    if not content:
        raise InputError(f"{path} is empty; it needs a header and one row a point.")
    return _parquet(path, content) if name.endswith(".parquet") else _text(path, content)


def table_of(frame: pd.DataFrame, name: str) -> pd.DataFrame:
    """The cells of a data frame as if read from a file; rows count from 0, as by `frame.iloc`.

    `name` stands for it in an InputError, where two columns have one name.
    """
    names = [" ".join(str(column).split()) for column in frame.columns]
    _refuse_duplicates(name, names)
    kept = [place for place, column in enumerate(names) if not _SAVED_INDEX.fullmatch(column)]
    cells = frame.iloc[:, kept].set_axis([names[place] for place in kept], axis=1)
    return cells.set_axis(range(len(frame)))


def _parquet(path: Path, content: bytes) -> pd.DataFrame:
    try:
        table = pyarrow.parquet.read_table(pyarrow.BufferReader(content))
        cells = table.to_pandas(ignore_metadata=True)
    except (pyarrow.ArrowException, OSError):
        raise InputError(f"{path} is not a whole parquet file; write it anew.") from None
    _refuse_duplicates(path, table.column_names)
    named = [name for name in cells.columns if not _SAVED_INDEX.fullmatch(str(name))]
    return cells[named].set_axis(range(1, len(cells) + 1))


def _text(path: Path, content: bytes) -> pd.DataFrame:
    if path.name.lower().endswith(".gz"):
        try:
            content = gzip.decompress(content)
        except (OSError, EOFError, zlib.error):
            raise InputError(f"{path} is not a whole gzip file; compress it anew.") from None
    if b"\0" in content:
        raise InputError(
            f"{path} is a binary file, not text; save the table as comma-separated UTF-8 text."
        )
    try:
        text = content.decode("utf-8-sig").rstrip()
    except UnicodeDecodeError as error:
        row = content.count(b"\n", 0, error.start) + 1
        raise InputError(
            f"{path} holds bytes in row {row} that are no UTF-8 text; save the table as "
            "comma-separated UTF-8 text."
        ) from None
    if not text:
        raise InputError(f"{path} is empty; it needs a header and one row a point.")
    header = _header(path, text)
    cells = pd.read_csv(
        io.StringIO(text),
        names=range(len(header)),
        skiprows=1,
        dtype=str,
        keep_default_na=False,
        skip_blank_lines=False,
    )
    cells.index = pd.RangeIndex(2, len(cells) + 2)
    named = [place for place, name in enumerate(header) if not _SAVED_INDEX.fullmatch(name)]
    return cells[named].set_axis([header[place] for place in named], axis=1)


def _header(path: Path, text: str) -> list[str]:
    """The names of the columns; InputError if a row has another number of cells."""
    # Where a quoted cell holds a line break the row is the one a spreadsheet shows.
    rows = csv.reader(io.StringIO(text, newline=""), strict=True)
    number = 0
    try:
        for number, row in enumerate(rows, start=1):
            if number == 1:
                header = [" ".join(name.split()) for name in row]
                if len(header) == 1 and any(mark in text for mark in ";\t"):
                    raise InputError(
                        f"{path} is not separated by commas; write commas between cells."
                    )
                _refuse_duplicates(path, header)
            elif not row:
                raise InputError(f"{path} has no cells in row {number}; leave out the empty row.")
            elif len(row) != len(header):
                raise InputError(
                    f"{path} has {len(row)} cells in row {number} where its header has "
                    f"{len(header)} columns; give every row one cell for each column."
                )
    except csv.Error as error:
        raise InputError(
            f"{path} is not comma-separated text after row {number} ({error}); correct that row."
        ) from None
    return header


def _refuse_duplicates(path: Path | str, names: list[str]) -> None:
    twice = next((name for name in names if name and names.count(name) > 1), None)
    if twice is not None:
        raise InputError(f"{path} has the column {twice} twice; give every column its own name.")
