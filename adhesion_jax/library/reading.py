"""What the functions take as data: data frames, files, and the sets that ship with the package."""

from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path

import numpy as np
import pandas as pd

from adhesion_jax.data import SHIPPED, Measured, read_all, read_measured, to_measured
from adhesion_jax.data.corrections import NOTHING, Corrections
from adhesion_jax.data.gaps import FEW
from adhesion_jax.data.reading import Progress
from adhesion_jax.errors import InputError
from adhesion_jax.runtime import silent

#: A table of measured points: a data frame, columns by their names, a file (or a folder or pattern
#: of files) by its path, a set that ships by its name, or what has been read of one of these.
Data = pd.DataFrame | Mapping[str, object] | str | PathLike[str] | Measured

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
    if isinstance(data, (pd.DataFrame, Mapping)):
        return to_measured(name, _frame(data), columns, known, few)
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
    frames = (pd.DataFrame, Mapping)
    files = [_path(part) for part in parts if not isinstance(part, (*frames, Measured))]
    if len(files) == len(parts):
        return [
            one._replace(name=name_of(part))
            for part, one in zip(parts, read_all(files, columns, known, progress, few), strict=True)
        ]
    tables = [measured_of(part, columns, known, progress, few) for part in parts]
    if len(tables) > 1 and any(isinstance(part, frames) for part in parts):
        # Runs of one name are told apart by that of their table.
        return [table._replace(name=f"table {i}") for i, table in enumerate(tables, 1)]
    return tables


def parts_of(data: Data | Sequence[Data]) -> Sequence[Data]:
    single = isinstance(data, (pd.DataFrame, Mapping, str, PathLike, Measured))
    return [data] if single else data  # type: ignore[list-item, return-value]


def name_of(data: Data) -> str:
    if isinstance(data, Measured):
        return data.name
    return _FRAME if isinstance(data, (pd.DataFrame, Mapping)) else str(data)


def _frame(data: pd.DataFrame | Mapping[str, object]) -> pd.DataFrame:
    if isinstance(data, pd.DataFrame):
        return data
    try:
        return pd.DataFrame({name: np.asarray(values) for name, values in data.items()})
    except ValueError as error:
        raise InputError(
            f"The columns make no table ({error}); give arrays of one dimension and one length."
        ) from None


def citation_of(data: Data) -> str:
    name = name_of(data)
    return SHIPPED[name].citation if name in SHIPPED else ""


def _path(data: object) -> Path:
    if not isinstance(data, (str, PathLike)):
        raise InputError(
            "Data are a pandas DataFrame, arrays by the names of their columns, as "
            '{"slip_ratio": slips, "adhesion": mu}, or the path of a file, not '
            f"{type(data).__name__}."
        )
    name = str(data)
    return SHIPPED[name].path if name in SHIPPED else Path(data)
