"""How the columns of a measurement were understood, as a table for a terminal."""

from adhesion_jax.data import Measured
from adhesion_jax.wording import number

_HEADINGS = ("column", "taken as", "unit", "range", "missing")


def understood(measured: Measured) -> str:
    """A line for each column: what it is taken as, its unit, range and share missing; notes.

    The unit is that of the file; the range is in the unit that the name of the quantity ends in.
    """
    rows = [_HEADINGS]
    for column, taken_as, unit, lowest, highest, missing in measured.understood.to_numpy():
        span = f"{number(lowest)} to {number(highest)}" if number(lowest) else ""
        rows.append((column, taken_as, unit, span, f"{100 * missing:.3g} %"))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]
    used = f"{measured.name}: {len(measured.table):,} rows are used."
    return "\n".join([used, *lines, *measured.notes])
