"""Measured tables as one: with the columns that all have, and the runs of all."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from adhesion_jax.data.columns import COLUMNS, LABELS
from adhesion_jax.data.grouping import group
from adhesion_jax.data.reading import Measured
from adhesion_jax.errors import InputError


def as_one(files: Sequence[Measured]) -> Measured:
    """Measured tables as one, with the columns that all have and the runs of all (`group`)."""
    if len(files) == 1:
        return files[0]
    refuse_two_kinds(files)
    table, incomplete = joined(files)
    grouping = group(files)
    names = np.array(grouping.names, dtype=object)
    return Measured(
        ", ".join(file.name for file in files),
        table.assign(run=names[grouping.run]),
        files[0].slip,
        tuple(str(name) for name in table if name not in {*COLUMNS, *LABELS}),
        tuple(dict.fromkeys([*incomplete, *(name for file in files for name in file.left_out)])),
        pd.concat([file.understood for file in files], ignore_index=True),
        tuple(note for file in files for note in file.notes),
        tuple(note for file in files for note in file.gaps),
    )


def refuse_two_kinds(files: Sequence[Measured]) -> None:
    """InputError where slip is a ratio in some files and a velocity in others."""
    other = next((file for file in files if file.slip != files[0].slip), None)
    if other is not None:
        ratio, velocity = (files[0], other) if files[0].slip == "slip_ratio" else (other, files[0])
        raise InputError(
            f"{velocity.name} has slip_velocity_mps without vehicle_speed_mps where {ratio.name} "
            "has a slip ratio; give every file the same kind of slip."
        )


def joined(files: Sequence[Measured]) -> tuple[pd.DataFrame, list[str]]:
    """All rows with the columns that every file has, and the names of those that some lack."""
    tables = []
    for file in files:
        table = file.table
        if "slip_velocity_mps" not in table and "vehicle_speed_mps" in table:
            velocity = table["slip_ratio"] * table["vehicle_speed_mps"]
            columns = {**dict(table.items()), "slip_velocity_mps": velocity}
            table = pd.DataFrame(columns, copy=False)  # pandas warns of `assign` to many columns
        tables.append(table)
    names = dict.fromkeys(str(name) for table in tables for name in table)
    shared = [name for name in names if all(name in table for table in tables)]
    if len(tables) == 1:
        return tables[0], []
    # The runs of all tables are told apart by `group`.
    shared_by_all = {
        name: _one_after_the_other([table[name] for table in tables])
        for name in shared
        if name != "run"
    }
    lacking = [name for name in names if name not in {*shared, "run"}]
    return pd.DataFrame(shared_by_all, copy=False), lacking


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
