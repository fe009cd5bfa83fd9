"""The parts of a page of a report, from which every rendering is made."""

import math
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import pandas as pd

#: What each figure shows, by the report and the file.
CAPTIONS: Mapping[str, Mapping[str, str]] = tomllib.loads(
    Path(__file__).with_name("captions.toml").read_text(encoding="utf-8")
)


class Paragraph(NamedTuple):
    text: str


class Formula(NamedTuple):
    text: str


class Items(NamedTuple):
    texts: Sequence[str]


class Table(NamedTuple):
    """Cells are written as they stand; columns whose heading is in `right` are set flush right.

    A folded table is long: it can be opened where the rendering can fold. Rows whose places are in
    `quiet` do not count, and are set in grey.
    """

    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    right: Sequence[str] = ()
    folded: str = ""
    quiet: Sequence[int] = ()


def table_of(frame: pd.DataFrame, digits: int = 4, folded: str = "") -> Table:
    """All of a data frame, numbers with some digits and flush right; empty where there is none."""
    numbers = [str(name) for name in frame if pd.api.types.is_numeric_dtype(frame[name])]

    def cell(value: object) -> str:
        if isinstance(value, float):
            return f"{value:.{digits}g}" if math.isfinite(value) else ""
        return str(value)

    rows = [[*map(cell, row)] for row in frame.to_numpy(dtype=object)]
    return Table([*frame], rows, numbers, folded)


class Picture(NamedTuple):
    file: str
    caption: str


Block = Paragraph | Formula | Items | Table | Picture


class Section(NamedTuple):
    title: str
    blocks: Sequence[Block]
    boxed: bool = False


class Page(NamedTuple):
    title: str
    verdict: str
    sections: Sequence[Section]
