"""The table of the benchmark, and the baseline as a file of it."""

from pathlib import Path

import pandas as pd
import pyarrow

from adhesion_jax.data.files import sheet_of_file
from adhesion_jax.errors import InputError

#: The columns that identify a row.
KEYS = ("scenario", "identifier", "rail", "quantity")

#: Figures of a quantity on a rail; empty in a row of speed.
ACCURACY = (
    *("bias", "bias_se", "rmse", "rmse_se", "coverage95", "coverage95_se"),
    *("failure_share", "failure_share_se", "runs"),
)

#: The quantity of a row of speed, whose rail is empty.
SPEED = "speed"

COLUMNS = (*KEYS, *ACCURACY, "speed", "speed_spread")

_REMEDY = "write it anew with --update"


def assemble(accuracy: pd.DataFrame, speed: pd.DataFrame) -> pd.DataFrame:
    """The whole table, in the order of its columns."""
    return pd.concat([accuracy, speed], ignore_index=True).reindex(columns=list(COLUMNS))


def _cells(path: Path) -> pd.DataFrame:
    """All cells of a file as they are written; its index holds the row numbers of the file."""
    sheet = sheet_of_file(path)
    empty = {name: pyarrow.array([], pyarrow.string()) for name in sheet.columns}
    blocks = [pyarrow.table(block) for block, _ in sheet.blocks()] or [pyarrow.table(empty)]
    cells = pyarrow.concat_tables(blocks).to_pandas()
    return cells.set_axis(range(sheet.first_row, sheet.first_row + len(cells)))


def read_baseline(path: Path) -> pd.DataFrame:
    """The table in a file; InputError if there is no file or it holds no such table."""
    if not path.is_file():
        raise InputError(f"--baseline {path} does not exist; make it with --update.")
    cells = _cells(path)
    missing = [name for name in COLUMNS if name not in cells]
    if missing:
        raise InputError(f"{path} has no column {missing[0]}; {_REMEDY}.")
    if cells.empty:
        raise InputError(f"{path} has a header and no rows; {_REMEDY}.")
    table = pd.DataFrame({name: cells[name].fillna("").astype(str) for name in KEYS})
    for name in COLUMNS[len(KEYS) :]:
        text = cells[name].fillna("").astype(str).str.strip()
        table[name] = pd.to_numeric(text.where(text != "", "nan"), errors="coerce")
        words = text[table[name].isna() & ~text.str.lower().isin(["", "nan"])]
        if len(words):
            raise InputError(
                f"{path} row {words.index[0]}, column {name}: {words.iloc[0]!r} is not a number; "
                f"{_REMEDY}."
            )
    speed = table["quantity"] == SPEED
    for name, rows in (("runs", ~speed), (SPEED, speed)):
        bad = table.index[rows & ~(table[name] > 0)]
        if len(bad):
            raise InputError(f"{path} row {bad[0]}, column {name} is not above 0; {_REMEDY}.")
    twice = table.index[table.duplicated(list(KEYS))]
    if len(twice):
        raise InputError(f"{path} row {twice[0]} repeats an earlier row; {_REMEDY}.")
    return table.reset_index(drop=True)
