"""How a text file writes a table: characters, separator, decimal mark, header, row of units."""

import codecs
import csv
import io
import itertools
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from io import BufferedIOBase
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow.csv

from adhesion_jax.data.cells import MISSING, decimal_mark, numbers_in
from adhesion_jax.data.columns import known
from adhesion_jax.errors import InputError
from adhesion_jax.wording import listed

#: Bytes read at a time, of which the first show UTF-16, and around what is no UTF-8.
_CHUNK = 1 << 22
_BEGINNING = 1 << 18
_AROUND = 1 << 14

_MARKS = {b"\xef\xbb\xbf": "utf-8-sig", b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16"}

#: Characters beyond ASCII that tables of measurements have: signs, which stand in no word (but ²
#: and ³ follow a letter), and letters.
_SIGNS = "°µ±·Ω€‰№–…„“”’´«»"
_WESTERN = "äöüßÄÖÜéèêëàâçîïôûùáíóúñåøæÅØÆÉÈÀÇÑ"
_EASTERN = "äöüßÄÖÜéáíóúýąćęłńśźżčďěňřšťůžőűăâîșțşţĄĆĘŁŃŚŹŻČĎĚŇŘŠŤŮŽŐŰ"

#: Encodings of one byte a character that spreadsheets and loggers in Europe write, the most usual
#: first, and their letters.
_LETTERS = {
    "cp1252": _WESTERN,
    "cp850": _WESTERN,
    "mac_roman": _WESTERN,
    "cp1250": _EASTERN,
    "cp1251": "".join(map(chr, range(0x410, 0x450))),
}

#: The share of the characters beyond ASCII that are these, at least.
_MOSTLY = 0.5

#: What no text has.
_CONTROL = re.compile(rb"[\x01-\x08\x0e-\x1a\x1c-\x1f]")


def encoding_of(stream: BufferedIOBase, path: str) -> str:
    """The encoding of a whole file, which is read once for that; InputError for a binary file."""
    chunk = stream.read(_CHUNK)
    for mark, encoding in _MARKS.items():
        if chunk.startswith(mark):
            return encoding
    head = chunk[:_BEGINNING]
    if b"\0" in head:
        # In UTF-16 without a mark every other byte of plain letters is 0.
        for encoding, zeros in (("utf-16-le", head[1::2]), ("utf-16-be", head[::2])):
            if zeros.count(0) > 0.9 * len(zeros):
                return encoding
        raise InputError(
            f"{path} is a binary file, not text; save the table as comma-separated UTF-8 text."
        )
    decoder = codecs.getincrementaldecoder("utf-8")()
    try:
        while chunk:
            decoder.decode(chunk)
            chunk = stream.read(_CHUNK)
        decoder.decode(b"", final=True)
        return "utf-8"
    except UnicodeDecodeError as error:
        strange = error.object[max(error.start - _AROUND, 0) : error.start + _AROUND]
    found = None if b"\0" in strange else _one_byte(strange)
    if found is None:
        raise InputError(
            f"{path} is a binary file or text of an unknown encoding; save the table as "
            "comma-separated UTF-8 text."
        )
    return found


def _one_byte(content: bytes) -> str | None:
    """The encoding in which most characters beyond ASCII are those of tables; None where none is.

    Where several make as many of them, the first counts. A table of numbers has no language, by
    which an encoding of prose is told; so a sign counts where it stands in no word, as in °C, and a
    letter where it does.
    """
    shares = {}
    for encoding, letters in _LETTERS.items():
        try:
            text = f" {content.decode(encoding)} "
        except UnicodeDecodeError:
            continue
        found = [
            _fits(text[place - 1], one, text[place + 1], letters)
            for place, one in enumerate(text)
            if not one.isascii()
        ]
        shares[encoding] = sum(found) / len(found)
    best = max(shares, key=lambda encoding: shares[encoding], default="")
    return best if best and shares[best] > _MOSTLY and not _CONTROL.search(content) else None


def _fits(before: str, one: str, after: str, letters: str) -> bool:
    """Whether a character fits between two others."""
    if one in "²³":
        return before.isalpha()
    if one in _SIGNS:
        return not (before.isalpha() and after.isalpha())
    alone = not (before + after).strip(" ;,\t\r\n")
    in_word = before.islower() or after.islower() or (one.isupper() and (before + after).isupper())
    return one in letters and (alone or in_word)


#: Separator to the word for it.
SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "bars", " ": "spaces"}

#: Any number of spaces separates cells, and none stands before the first or after the last of a
#: line. NumPy begins its header with a mark of a comment.
_SPACED = (
    (re.compile(rb"(?m)^[# \t]+|[ \t]+(?=\r?$)"), b""),
    (re.compile(rb"[ \t]+"), b"\t"),
)

#: Bytes from the beginning of a file from which the dialect is told, and the most rows of them.
_HEAD = 1 << 18
_ROWS = 200
#: Rows that differ from the header, and agree with each other, show that it is none.
_FEW = 3


class Dialect(NamedTuple):
    """How a text file is written; `rows` are its first rows of data, as text."""

    encoding: str
    separator: str
    mark: str | None  # the decimal mark, where the first rows show one
    names: tuple[str, ...]
    units: tuple[str, ...]  # of the row under the header, empty without one
    skipped: int  # lines above the header, such as `sep=;` or what a logger says of itself
    above: int  # lines above the first row of data
    quoted: bool  # whether a cell in the first rows is quoted
    rows: tuple[tuple[str, ...], ...]

    @property
    def sentence(self) -> str:
        """How the file is written, in words that follow `The log has`."""
        encoding = {"utf-8": "", "utf-8-sig": ""}.get(self.encoding, f"{self.encoding} text, ")
        mark = {",": ", decimal commas", ".": ", decimal points"}.get(self.mark or "", "")
        units = f", units in row {self.above}" if self.units else ""
        header = f", names of columns in row {self.skipped + 1}" if self.skipped else ""
        separator = SEPARATORS.get(self.separator, self.separator)
        return f"{encoding}cells separated by {separator}{mark}{header}{units}"


def _tabbed(lines: bytes) -> bytes:
    """Lines of cells separated by spaces as lines of cells separated by tabs."""
    for spaces, written in _SPACED:
        lines = spaces.sub(written, lines)
    return lines


class Tabbed(io.RawIOBase):
    """A stream of lines of cells separated by spaces, as cells separated by tabs."""

    def __init__(self, stream: BufferedIOBase) -> None:
        self._stream, self._rest = stream, memoryview(b"")

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        while not self._rest:
            lines = self._stream.read(_CHUNK)
            if not lines:
                return 0
            self._rest = memoryview(_tabbed(lines + self._stream.readline()))
        count = min(len(buffer), len(self._rest))
        buffer[:count] = self._rest[:count]
        self._rest = self._rest[count:]
        return count


def tidy(name: str) -> str:
    """A name of a column on one line, without characters that steer a terminal."""
    seen = (one if one.isprintable() or one.isspace() else "" for one in name)
    return " ".join("".join(seen).split())


def dialect_of(stream: BufferedIOBase, encoding: str, path: str) -> Dialect:
    """The dialect, from the head of a stream; InputError where that shows no table."""
    content = stream.read(_HEAD)
    cut = len(content) == _HEAD
    try:
        text = content.decode(encoding, errors="ignore" if cut else "strict")
    except UnicodeDecodeError:
        raise InputError(
            f"{path} ends within a character of {encoding} text; copy the file anew."
        ) from None
    text = text.removeprefix("\ufeff")
    if not text.strip() and not cut:
        raise InputError(f"{path} is empty; it needs a header and one row a point.")
    skipped = 0
    separator = None
    told = re.match(r"sep=(.)\r?\n", text)
    if told:
        skipped, separator, text = 1, told[1], text[told.end() :]
    if cut:
        text = text[: text.rfind("\n") + 1] or text
    separator = separator or _separator(text, spaces=not encoding.startswith("utf-16"))
    rows = _rows(text, separator, path)
    header = _header(rows)
    # A quoted cell may go on in the next line.
    skipped += sum(1 + sum(cell.count("\n") for cell in row) for row in rows[:header])
    rows, above, groups = rows[header:], skipped, rows[header - 1 : header]
    if len(rows) > 2 and _are_groups(rows[0]) and _may_name(rows[1], len(rows[0])):
        skipped, above, groups, rows = skipped + 1, above + 1, rows[:1], rows[1:]
    # NumPy begins its header with a mark of a comment.
    names = tuple(map(tidy, [rows[0][0].lstrip("# "), *rows[0][1:]]))
    if groups and len(groups[0]) == len(names):
        names = _of_groups(groups[0], names)
    if not any(names):
        raise InputError(
            f"{path} has no names of columns in row {above + 1}; begin it with a header."
        )
    numbers = numbers_in(names)
    if len(numbers) == len([name for name in names if name]) > 0:
        raise InputError(
            f"{path} has numbers in row {above + 1}, where the names of the columns belong; write "
            "a header above them."
        )
    above += 1
    counts = {len(row) for row in rows[1:]}
    # With commas the cells may be too many because numbers have decimal commas.
    other = len(counts) == 1 and {len(names)} != counts and (separator != "," or len(names) == 1)
    if other and len(rows) > _FEW:
        raise InputError(
            f"{path} has {counts.pop()} cells in row {above + 1} where its header has {len(names)};"
            " give every row a cell for each column, and leave out any lines above the header."
        )
    units: tuple[str, ...] = ()
    below = rows[1] if len(rows) > 1 else []
    if len(below) == len(names) and not numbers_in(below):
        stripped = tuple(cell.strip().strip("[]()<>{}").strip() for cell in below)
        are_units = [known(unit) for unit in stripped if unit not in ("", "-")]
        if any(are_units) and sum(are_units) >= len(are_units) / 2:
            units, above = stripped, above + 1
        elif (  # where the third row has numbers, the second is a header too
            len(rows) > 2
            and all(below)
            and len(numbers_in(rows[2])) > len(rows[2]) / 2
            and not {*below} & {*MISSING}
        ):
            raise InputError(
                f"{path} has two headers, in rows {above} and {above + 1} (its second row holds "
                f"{listed([cell.strip() for cell in below[:3]])}); leave one of them."
            )
    first = above - skipped
    data = tuple(tuple(row) for row in rows[first:] if len(row) == len(names))
    mark = decimal_mark(itertools.chain.from_iterable(data))
    return Dialect(encoding, separator, mark, names, units, skipped, above, '"' in text, data)


def _header(rows: Sequence[Sequence[str]]) -> int:
    """The place of the header: 0, or that of the first row that must be it, as below a preamble.

    The first row is none where it has fewer or more cells than most rows, no name for most of them,
    or a number among them. Another one is where all its cells are text and one of the next two rows
    holds numbers, in as many cells.
    """
    usual = Counter(map(len, rows)).most_common(1)[0][0]

    def may_be(row: Sequence[str]) -> bool:
        return len(row) == usual and sum(map(bool, row)) > usual / 2 and not numbers_in(row)

    if usual < 2 or may_be(rows[0]):
        return 0
    for place in range(1, len(rows) - 1):
        below = rows[place + 1 : place + 3]
        same = all(len(row) == usual for row in below)
        if same and may_be(rows[place]) and any(numbers_in(row) for row in below):
            return place
    return 0


def _are_groups(row: Sequence[str]) -> bool:
    """Whether a row above the names holds groups of columns: some stand there twice, or nothing."""
    cells = [cell.strip() for cell in row]
    return ("" in cells or len({*cells}) < len(cells)) and not numbers_in(row)


def _may_name(row: Sequence[str], columns: int) -> bool:
    """Whether a row may hold the names of so many columns, and no units."""
    units = [known(cell.strip("[]()<>{} ")) for cell in row if cell.strip() not in ("", "-")]
    return len(row) == columns and all(row) and not numbers_in(row) and sum(units) < len(row) / 2


def _of_groups(groups: Sequence[str], names: Sequence[str]) -> tuple[str, ...]:
    """Names that stand there twice with the name of their group, which goes on over empty cells."""
    found, group = [], ""
    for above, name in zip(groups, names, strict=True):
        group = tidy(above) or group
        found.append(f"{group} {name}" if [*names].count(name) > 1 and group else name)
    return tuple(found)


def _separator(text: str, spaces: bool) -> str:
    """The separator by which most rows have as many cells as the header, or as each other.

    Names may hold spaces, which separate cells only where no mark does, if at all.
    """

    def likeness(separator: str) -> tuple[int, int, int]:
        rows = _parsed(text, separator)
        counts = [len(row) for row in rows[_header(rows) :]]
        usual, many = Counter(counts).most_common(1)[0]
        alike = counts.count(counts[0]) if counts[0] > 1 else 0
        return alike, many if usual > 1 else 0, counts[0]

    found = max((mark for mark in SEPARATORS if mark != " "), key=likeness)
    return " " if spaces and not likeness(found)[0] and likeness(" ")[0] > 1 else found


def _parsed(text: str, separator: str) -> list[list[str]]:
    rows = _reader(text, separator)
    try:
        return list(itertools.islice((row for row in rows if row), _ROWS)) or [[""]]
    except csv.Error:
        return [[""]]


def _reader(text: str, separator: str, strict: bool = False) -> Iterator[list[str]]:
    if separator == " ":
        text, separator = _tabbed(text.encode()).decode(), "\t"
    return csv.reader(io.StringIO(text, newline=""), delimiter=separator, strict=strict)


def _rows(text: str, separator: str, path: str) -> list[list[str]]:
    rows = _reader(text, separator, strict=True)
    found: list[list[str]] = []
    try:
        for row in itertools.islice(rows, _ROWS):
            found.append(row)
    except csv.Error as error:
        raise InputError(
            f"{path} is not a table of text from row {len(found) + 1} on ({error}); correct that "
            "row, in which a quotation mark may not be closed."
        ) from None
    return found


def ragged(path: Path, dialect: Dialect, rows: Sequence[pyarrow.csv.InvalidRow]) -> InputError:
    """What is said of the first row that has more or fewer cells than the header."""
    row, columns = rows[0], len(dialect.names)
    cells = f"{row.actual_columns} cell{'s' if row.actual_columns > 1 else ''}"
    other = [mark for mark in SEPARATORS if row.text.count(mark) == columns - 1]
    if other and other[0] != dialect.separator:
        advice = (
            f"its cells are separated by {SEPARATORS[other[0]]} and those of the header by "
            f"{SEPARATORS[dialect.separator]}: use one of them throughout"
        )
    elif dialect.separator == "," and row.actual_columns > columns and "," in row.text:
        advice = (
            "give every row one cell for each column; where numbers have a decimal comma, "
            "separate the cells by semicolons"
        )
    elif row.actual_columns < columns and len(rows) == 1:
        advice = (
            "give every row one cell for each column; if it is the last row the file was cut off, "
            "and is to be copied anew or to end before that row"
        )
    else:
        advice = "give every row one cell for each column"
    return InputError(
        f"{path} has {cells} in row {row.number} where its header has {columns} columns; {advice}."
    )
