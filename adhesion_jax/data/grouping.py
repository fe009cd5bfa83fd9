"""Which rows of a measured table make up a run, and several tables as one."""

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from adhesion_jax.data.columns import COLUMNS, LABELS
from adhesion_jax.data.reading import Measured
from adhesion_jax.data.stretches import stretches
from adhesion_jax.errors import InputError


class Grouping(NamedTuple):
    """The run of every row, [rows], from 0 in the order in which the runs begin."""

    run: np.ndarray
    names: tuple[str, ...]


def group(measured: Measured) -> Grouping:
    """The runs of a table: by the column run, else by gaps in time_s, else by the file, if any.

    With a time each axle has runs of its own, for its rows are a signal of their own.
    """
    table = measured.table
    label = next((one for one in ("run", "file") if one in table), "")
    if label == "run" or (label and "time_s" not in table):
        codes, names = pd.factorize(table[label])
        return Grouping(codes.astype(np.int32), tuple(map(str, names)))
    codes = np.zeros(len(table), np.int32)
    if "time_s" in table:
        axle = table["axle"].cat.codes if "axle" in table else codes
        for number, rows in enumerate(stretches(table["time_s"].to_numpy(), np.asarray(axle))):
            codes[rows] = number
    return Grouping(codes, tuple(map(str, range(1, int(codes.max(initial=0)) + 2))))


def as_one(files: Sequence[Measured]) -> Measured:
    """Measured tables as one, with the columns that all have, and the runs of all (`group`).

    No run reaches over two files: a name that stands in several of them is named file:name.
    InputError where slip is a ratio in some files and a velocity in others.
    """
    if len(files) == 1:
        return files[0]
    other = next((file for file in files if file.slip != files[0].slip), None)
    if other is not None:
        ratio, velocity = (files[0], other) if files[0].slip == "slip_ratio" else (other, files[0])
        raise InputError(
            f"{velocity.name} has slip_velocity_mps without vehicle_speed_mps where {ratio.name} "
            "has a slip ratio; give every file the same kind of slip."
        )
    tables = [with_velocity(file.table) for file in files]
    names = dict.fromkeys(str(name) for table in tables for name in table if name != "run")
    shared = [name for name in names if all(name in table for table in tables)]
    columns = {name: _one_after_the_other([table[name] for table in tables]) for name in shared}
    parts = [group(file) for file in files]
    in_files = Counter(name for part in parts for name in part.names)
    columns["run"] = np.concatenate(
        [
            np.array([f"{file.name}:{n}" if in_files[n] > 1 else n for n in part.names], object)[
                part.run
            ]
            for file, part in zip(files, parts, strict=True)
        ]
    )
    left_out = {name: why for file in files[::-1] for name, why in file.left_out.items()}
    incomplete = [
        f"The column {name} is left out: not every file has it."
        for name in names
        if name not in {*shared, *left_out}
    ]
    return Measured(
        ", ".join(file.name for file in files),
        pd.DataFrame(columns, copy=False),
        files[0].slip,
        tuple(name for name in columns if name not in {*COLUMNS, *LABELS}),
        left_out,
        pd.concat([file.understood for file in files], ignore_index=True),
        (*(note for file in files for note in file.notes), *incomplete),
        (*(note for file in files for note in file.gaps), *incomplete),
    )


def with_velocity(table: pd.DataFrame) -> pd.DataFrame:
    """The table with the slip velocity, where it has slip ratio and vehicle speed alone."""
    if "slip_velocity_mps" in table or "vehicle_speed_mps" not in table:
        return table
    velocity = table["slip_ratio"] * table["vehicle_speed_mps"]
    columns = {**dict(table.items()), "slip_velocity_mps": velocity}
    return pd.DataFrame(columns, copy=False)  # pandas warns of `assign` to many columns


def _one_after_the_other(parts: Sequence[pd.Series]) -> np.ndarray | pd.Categorical:
    """The values of columns of one name, those of labels with the labels of all.

    Where some files have labels, the numbers of the others are labels as well.
    """
    if not any(isinstance(part.dtype, pd.CategoricalDtype) for part in parts):
        return np.concatenate([part.to_numpy() for part in parts])
    labels = [
        part
        if isinstance(part.dtype, pd.CategoricalDtype)
        else part.map(lambda value: f"{value:g}").astype("category")
        for part in parts
    ]
    return pd.api.types.union_categoricals(labels)
