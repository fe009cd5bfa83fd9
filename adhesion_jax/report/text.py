"""Texts for a terminal: filled paragraphs, tables flush left, and values with their errors."""

import textwrap
from collections.abc import Iterable

import pandas as pd

from adhesion_jax.wording import plus_minus

#: Width of a line.
WIDTH = 96


def filled(text: str) -> str:
    """The text in lines, those after the first indented; names keep their hyphens."""
    return textwrap.fill(text, WIDTH, subsequent_indent="  ", break_on_hyphens=False)


def flush_left(table: pd.DataFrame) -> str:
    """A table of texts, headings and cells flush left."""
    # pandas can set the headings flush left, the cells only by padding them.
    padded = table.apply(lambda column: column.str.ljust(column.str.len().max()))
    return padded.to_string(index=False, justify="left")


def with_errors(values: Iterable[float], errors: Iterable[float]) -> list[str]:
    return [plus_minus(value, error) for value, error in zip(values, errors, strict=True)]
