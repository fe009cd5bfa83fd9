"""What the functions take as data: data frames, files, and the sets that ship with the package."""

from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path

import pandas as pd

from adhesion_jax.data import (
    SHIPPED,
    Measured,
    read_all,
    read_measured,
    to_measured,
)
from adhesion_jax.data.corrections import NOTHING, Corrections
from adhesion_jax.data.gaps import FEW
from adhesion_jax.data.reading import Progress
from adhesion_jax.errors import InputError
from adhesion_jax.runtime import silent

#: A table of measured points: a data frame, a file by its path, a set that ships by its name, or
#: what has been read of one of these.
Data = pd.DataFrame | str | PathLike[str] | Measured

#: What is said for a data frame, which has no name.
_FRAME = "the data frame"


def measured_of(
    data: Data,
    columns: Mapping[str, object] | None = None,
    known: Corrections = NOTHING,
    progress: Progress = silent,
    few: float = FEW,
) -> Measured:
    """The data as measured points; see `data.read_measured`."""
    if isinstance(data, Measured):
        return data
    name = name_of(data)
    if isinstance(data, pd.DataFrame):
        return to_measured(name, data, columns, known, few)
    found = read_measured(_path(data), columns, known, progress, few)
    return found._replace(name=name)


def all_of(
    data: Data | Sequence[Data],
    columns: Mapping[str, object] | None = None,
    known: Corrections = NOTHING,
    progress: Progress = silent,
    few: float = FEW,
) -> list[Measured]:
    """Several tables; InputError names all that is wrong with any file of them."""
    parts = parts_of(data)
    files = [_path(part) for part in parts if not isinstance(part, (pd.DataFrame, Measured))]
    if len(files) == len(parts):
        return [
            one._replace(name=name_of(part))
            for part, one in zip(parts, read_all(files, columns, known, progress, few), strict=True)
        ]
    tables = [measured_of(part, columns, known, progress, few) for part in parts]
    if len(tables) > 1 and any(isinstance(part, pd.DataFrame) for part in parts):
        # Runs of one name are told apart by that of their table.
        return [table._replace(name=f"table {i}") for i, table in enumerate(tables, 1)]
    return tables


def parts_of(data: Data | Sequence[Data]) -> Sequence[Data]:
    single = isinstance(data, (pd.DataFrame, str, PathLike, Measured))
    return [data] if single else data  # type: ignore[list-item, return-value]


def name_of(data: Data) -> str:
    if isinstance(data, Measured):
        return data.name
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
