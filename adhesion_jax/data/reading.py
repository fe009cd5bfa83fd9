"""From a file to a validated measured record."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import jax.numpy as jnp
import pandas as pd

from adhesion_jax.data.columns import COLUMNS, LABELS
from adhesion_jax.data.files import read_table
from adhesion_jax.data.schema import cell_faults, label_faults, numbers, time_faults
from adhesion_jax.errors import InputError
from adhesion_jax.records import Record

#: A curve has up to five parameters; with fewer points its errors could not be estimated.
POINTS = 10


class Measured(NamedTuple):
    """A validated table: SI units, one row a point, what could be derived added to it."""

    name: str  # the file it was read from
    table: pd.DataFrame
    slip: str  # the column that is the slip: slip_ratio, or slip_velocity_mps without a speed
    covariates: tuple[str, ...]  # numeric columns that the project does not know
    left_out: tuple[str, ...]  # columns it does not know and that are not numbers throughout


def read_measured(path: Path) -> Measured:
    """A measured table with slip and adhesion from a file; see `to_measured`."""
    return to_measured(str(path), read_table(path))


def to_measured(name: str, cells: pd.DataFrame) -> Measured:
    """A measured table with slip and adhesion, or InputError naming all that is wrong with it.

    Needed are slip_ratio, or slip_velocity_mps (divided by vehicle_speed_mps where there is one),
    and adhesion, or tangential_force_N with normal_load_N. The other columns of COLUMNS and
    LABELS are checked where they are there; further numeric ones are kept as covariates. Whether
    the points are of use is for `check_curve` and `adhesion_faults` to say.
    """
    table, left_out = numbers(cells)
    faults: Sequence[str] = [
        *_missing_columns(table),
        *([] if len(table) else [too_few(0)]),
        *cell_faults(table, cells),
        *label_faults(table),
        *time_faults(table),
    ]
    if not faults:
        table, faults = _derive(table)
    if faults:
        raise InputError(f"{name} cannot be used: {'; '.join(faults)}.")
    slip = "slip_ratio" if "slip_ratio" in table else "slip_velocity_mps"
    known = {*COLUMNS, *LABELS}
    covariates = tuple(column for column in table.columns.astype(str) if column not in known)
    return Measured(name, table, slip, covariates, left_out)


def check_curve(measured: Measured) -> None:
    """Raises InputError if no curve can be identified although every cell is valid."""
    slip = measured.table[measured.slip]
    different = slip.abs().nunique()
    if len(slip) < POINTS:
        faults: Sequence[str] = [too_few(len(slip))]
    elif different < POINTS // 2:
        faults = [
            f"column {slip.name} has only {different} different sizes of slip "
            f"(a curve needs at least {POINTS // 2})"
        ]
    else:
        faults = adhesion_faults(slip, measured.table["adhesion"])
    if faults:
        raise InputError(f"{measured.name} cannot be used: {'; '.join(faults)}.")


def adhesion_faults(slip: pd.Series, adhesion: pd.Series) -> Sequence[str]:
    """Sentences on why the adhesion cannot belong to the slip, both [points]; none if it can."""
    if (adhesion == 0).all():
        return ["column adhesion is 0 in every row (no curve can be fitted to that)"]
    if slip.min() < slip.max() and (slip * adhesion).sum() <= 0:
        return [
            f"column adhesion is mostly of the other sign than {slip.name} "
            "(both are positive in traction and negative in braking)"
        ]
    return []


def too_few(points: int) -> str:
    """The fault of a table that has fewer than POINTS points."""
    held = {0: "there is a header but no point", 1: "there is one point"}.get(
        points, f"there are {points} points"
    )
    return f"{held} (at least {POINTS} rows of data are needed)"


def to_record(measured: Measured) -> Record:
    """Slip and adhesion of all points, and every numeric column as a condition."""
    table = measured.table
    conditions = {
        name: jnp.asarray(table[name].to_numpy(float))
        for name in table.columns.astype(str)
        if name not in LABELS
    }
    if measured.slip == "slip_velocity_mps":
        # Falling friction multiplies the slip by the vehicle speed to get the slip velocity. Here
        # the slip is already that velocity, and a speed of 1 leaves it unchanged.
        conditions["vehicle_speed_mps"] = jnp.ones(len(table))
    every = jnp.ones(len(table), dtype=bool)
    return Record(conditions[measured.slip], conditions["adhesion"], every, every, conditions)


def _missing_columns(table: pd.DataFrame) -> Sequence[str]:
    faults = []
    if "slip_ratio" not in table and "slip_velocity_mps" not in table:
        faults.append("the column slip_ratio (or slip_velocity_mps) is missing")
    if "adhesion" not in table and not {"tangential_force_N", "normal_load_N"} <= {*table}:
        alone = [name for name in ("tangential_force_N", "normal_load_N") if name in table]
        beside = f", {alone[0]} alone will not do" if alone else ""
        faults.append(
            "the column adhesion (or tangential_force_N with normal_load_N) is missing" + beside
        )
    if faults:
        there = ", ".join(table.columns.astype(str)[:12]) or "no column"
        more = " ..." if table.shape[1] > 12 else ""
        faults[-1] += f" (there are {there}{more})"
    return faults


def _derive(table: pd.DataFrame) -> tuple[pd.DataFrame, Sequence[str]]:
    """The table with adhesion from force and load, slip ratio or speed from each other; faults."""
    table = table.copy()
    faults: list[str] = []
    if "adhesion" not in table:
        table["adhesion"] = table["tangential_force_N"] / table["normal_load_N"]
    if "slip_ratio" not in table and "vehicle_speed_mps" in table:
        at_rest = table["vehicle_speed_mps"] == 0
        if at_rest.any():
            faults.append(
                f"column vehicle_speed_mps is 0 in row {at_rest.idxmax()}, where slip_velocity_mps "
                "gives no slip ratio (leave out the rows at rest)"
            )
        table["slip_ratio"] = table["slip_velocity_mps"] / table["vehicle_speed_mps"].where(
            ~at_rest, 1.0
        )
    elif "vehicle_speed_mps" not in table and {"slip_ratio", "slip_velocity_mps"} <= {*table}:
        slips = table["slip_ratio"] != 0
        speed = (table["slip_velocity_mps"] / table["slip_ratio"].where(slips)).abs()
        # At slip 0 adhesion does not depend on the speed: any finite value will do there.
        table["vehicle_speed_mps"] = speed.fillna(speed.median() if slips.any() else 0.0)
    # The derived columns must lie within the same ranges as the given ones.
    faults += cell_faults(table, table) if not faults else []
    return table, faults
