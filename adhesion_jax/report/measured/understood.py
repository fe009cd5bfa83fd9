"""How the columns of a measurement were understood, as a table for a terminal."""

import pandas as pd

from adhesion_jax.data import Measured
from adhesion_jax.report.page import Table
from adhesion_jax.report.text import in_columns
from adhesion_jax.wording import number


def understood(measured: Measured) -> str:
    """How many rows are used, the table of the columns, and the notes."""
    used = f"{measured.name}: {len(measured.table):,} rows are used."
    return "\n".join([used, columns_table(measured.understood), *measured.notes])


def columns_table(understood: pd.DataFrame) -> str:
    """A line for each column: what it is taken as, its unit, range and share missing.

    The range is in the unit beside it, which is that of the file.
    """
    rows = []
    for column, taken_as, unit, lowest, highest, missing in understood.to_numpy():
        span = f"{number(lowest)} to {number(highest)}" if number(lowest) else ""
        rows.append((column, taken_as, unit, span, f"{100 * missing:.3g} %"))
    return in_columns(Table(("column", "taken as", "unit", "range", "missing"), rows))
