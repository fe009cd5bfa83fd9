"""How the columns of a measurement were understood, as a table for a terminal."""

import pandas as pd

from adhesion_jax.data import Measured
from adhesion_jax.wording import number

_HEADINGS = ("column", "taken as", "unit", "range", "missing")


def understood(measured: Measured) -> str:
    """How many rows are used, the table of the columns, and the notes."""
    used = f"{measured.name}: {len(measured.table):,} rows are used."
    return "\n".join([used, columns_table(measured.understood), *measured.notes])


def columns_table(understood: pd.DataFrame) -> str:
    """A line for each column: what it is taken as, its unit, range and share missing.

    The range is in the unit beside it, which is that of the file.
    """
    rows = [_HEADINGS]
    for column, taken_as, unit, lowest, highest, missing in understood.to_numpy():
        span = f"{number(lowest)} to {number(highest)}" if number(lowest) else ""
        rows.append((column, taken_as, unit, span, f"{100 * missing:.3g} %"))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    )
