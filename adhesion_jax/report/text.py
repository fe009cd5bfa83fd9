"""Texts for a terminal: filled paragraphs, tables flush left, and values with their errors."""

import textwrap
from collections.abc import Callable, Iterable

import pandas as pd

from adhesion_jax.report.page import Table
from adhesion_jax.wording import plus_minus

#: Width of a line.
WIDTH = 96


def filled(text: str) -> str:
    """The text in lines, those after the first indented; names keep their hyphens."""
    return textwrap.fill(text, WIDTH, subsequent_indent="  ", break_on_hyphens=False)


def one_line(text: str) -> str:
    """A file may name its columns with anything: line breaks would break tables and labels."""
    return " ".join(text.split())


def flush_left(table: pd.DataFrame) -> str:
    """A table of texts, headings and cells flush left."""
    # pandas can set the headings flush left, the cells only by padding them.
    padded = table.apply(lambda column: column.str.ljust(column.str.len().max()))
    return padded.to_string(index=False, justify="left")


def aligned(table: Table, written: Callable[[str], str] = str) -> list[list[str]]:
    """The cells as they are written, headings first, each padded to the width of its column."""
    lines = [[*map(written, line)] for line in (table.headings, *table.rows)]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    pads = [str.rjust if name in table.right else str.ljust for name in table.headings]
    return [
        [pad(cell, width) for pad, cell, width in zip(pads, line, widths, strict=True)]
        for line in lines
    ]


def in_columns(table: Table) -> str:
    """The table for a terminal."""
    return "\n".join("  ".join(line).rstrip() for line in aligned(table))


def with_errors(values: Iterable[float], errors: Iterable[float]) -> list[str]:
    return [plus_minus(value, error) for value, error in zip(values, errors, strict=True)]
