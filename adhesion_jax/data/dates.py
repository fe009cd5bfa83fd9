"""Dates in one column and times of day in another, as one column of both."""

from collections.abc import Iterator

import pyarrow
import pyarrow.compute

from adhesion_jax.data.files import Block, Sheet
from adhesion_jax.data.stamps import AND_TIME, TIME_OF_DAY, is_date


def with_dates_joined(sheet: Sheet) -> Sheet:
    """A sheet in which a column of dates and the one column of times of day are one, of both names.

    Dates that are not joined are no stamps: a day alone does not tell the time.
    """
    dates = [name for name, form in sheet.stamps.items() if is_date(form)]
    clocks = [name for name, form in sheet.stamps.items() if form == TIME_OF_DAY]
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
            trimmed = map(pyarrow.compute.utf8_trim_whitespace, parts)
            cells[both] = pyarrow.compute.binary_join_element_wise(*trimmed, " ")
            yield cells, share

    columns = tuple(both if name == date else name for name in sheet.columns if name != clock)
    return sheet._replace(columns=columns, stamps=stamps, blocks=blocks)
