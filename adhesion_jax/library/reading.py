"""What the functions take as data: data frames, files, and the sets that ship with the package."""

from collections.abc import Sequence
from os import PathLike
from pathlib import Path

import pandas as pd

from adhesion_jax.data import (
    SHIPPED,
    Measured,
    RunSet,
    read_measured,
    read_runs,
    table_of,
    to_measured,
    to_runs,
)
from adhesion_jax.errors import InputError

#: A table of measured points: a data frame, a file by its path, or a set that ships by its name.
Data = pd.DataFrame | str | PathLike[str]

#: What is said for a data frame, which has no name.
_FRAME = "the data frame"


def measured_of(data: Data) -> Measured:
    name = name_of(data)
    if isinstance(data, pd.DataFrame):
        return to_measured(name, table_of(data, name))
    return read_measured(_path(data))._replace(name=name)


def runs_of(data: Data | Sequence[Data]) -> RunSet:
    parts = parts_of(data)
    if not any(isinstance(part, pd.DataFrame) for part in parts):
        return read_runs([_path(part) for part in parts])
    tables = [measured_of(part) for part in parts]
    if len(tables) > 1:  # runs of one name are told apart by that of their table
        tables = [table._replace(name=f"table {i}") for i, table in enumerate(tables, 1)]
    return to_runs(tables)


def parts_of(data: Data | Sequence[Data]) -> Sequence[Data]:
    return [data] if isinstance(data, (pd.DataFrame, str, PathLike)) else data


def name_of(data: Data) -> str:
    return _FRAME if isinstance(data, pd.DataFrame) else str(data)


def citation_of(data: Data) -> str:
    name = name_of(data)
    return SHIPPED[name].citation if name in SHIPPED else ""


def _path(data: object) -> Path:
    if not isinstance(data, (str, PathLike)):
        raise InputError(
            f"Data are a pandas DataFrame or the path of a file, not {type(data).__name__}."
        )
    name = str(data)
    return SHIPPED[name].path if name in SHIPPED else Path(data)
