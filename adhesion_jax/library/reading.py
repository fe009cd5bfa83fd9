"""What the functions take: data frames, files, sets that ship, and parts by their names."""

from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

import numpy as np
import pandas as pd

from adhesion_jax.data import SHIPPED, Measured, read_all, read_measured, to_measured
from adhesion_jax.data.events import Chosen, events_of
from adhesion_jax.data.forces import NOTHING, Corrections
from adhesion_jax.data.reading import Progress
from adhesion_jax.data.stretches import FEW
from adhesion_jax.errors import InputError
from adhesion_jax.identifiers import IDENTIFIERS, Identifier
from adhesion_jax.plugins import made
from adhesion_jax.runtime import silent
from adhesion_jax.wording import listed

T = TypeVar("T")

#: Names of IDENTIFIERS, or methods of one's own by name: objects, classes or functions.
Methods: TypeAlias = str | Sequence[object] | Mapping[str, Any]


def methods_named(identifiers: Methods) -> Mapping[str, Identifier]:
    """The identifiers by name; a function of slips and adhesions, or a class of NumPy, is one."""
    if isinstance(identifiers, Mapping):
        return own_parts("identifier", identifiers, IDENTIFIERS)
    return parts_named("identifier", "methods", identifiers, IDENTIFIERS)


def own_parts(kind: str, own: Mapping[str, Any], known: Mapping[str, T]) -> dict[str, T]:
    """Parts of the user's own by name; InputError for one of no use, or the name of another."""
    taken = [name for name, part in own.items() if known.get(name, part) is not part]
    if taken:
        raise InputError(
            f"{listed(taken)} is the name of a method of the package; name yours otherwise."
        )
    return {name: made(kind, name, part) for name, part in own.items()}


def parts_named(
    what: str, several: str, named: str | Sequence[object], known: Mapping[str, T]
) -> dict[str, T]:
    """The parts of these names; InputError for a name that there is not, and for none."""
    names: list[Any] = [named] if isinstance(named, str) else [*named]
    unknown = [
        one if isinstance(one, str) else str(getattr(one, "__name__", type(one).__name__))
        for one in names
        if one not in known
    ]
    if unknown or not names:
        raise InputError(
            f"There is no {what} {listed(unknown) if unknown else 'named'}; name some of "
            f"{', '.join(known)}, or give {several} of your own by name: {{'mine': Mine()}}."
        )
    return {name: known[name] for name in names}


#: A table of measured points: a data frame, columns by their names, a file (or a folder or pattern
#: of files) by its path, a set that ships by its name, or what has been read of one of these, or
#: chosen of its rows.
Data = pd.DataFrame | Mapping[str, object] | str | PathLike[str] | Measured | Chosen

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
    if isinstance(data, (Measured, Chosen)):
        return data if isinstance(data, Measured) else data.points
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
    files = [_path(part) for part in parts if not isinstance(part, (*frames, Measured, Chosen))]
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


def chosen_of(
    data: Data | Sequence[Data],
    columns: Mapping[str, object] | None,
    known: Corrections,
    events: bool | None,
    few: float = FEW,
) -> Sequence[Chosen]:
    """The rows of each table that are used; rows that were chosen before stay as they are."""
    parts = parts_of(data)
    chosen = [part for part in parts if isinstance(part, Chosen)]
    if chosen and len(chosen) == len(parts):
        return chosen
    return events_of(all_of(data, columns, known, few=few), events)


def parts_of(data: Data | Sequence[Data]) -> Sequence[Data]:
    single = isinstance(data, (pd.DataFrame, Mapping, str, PathLike, Measured, Chosen))
    return [data] if single else data  # type: ignore[list-item, return-value]


def name_of(data: Data) -> str:
    if isinstance(data, (Measured, Chosen)):
        return data.name if isinstance(data, Measured) else data.points.name
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
