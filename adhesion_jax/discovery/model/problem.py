"""From measured runs to the arrays of the compiled program, and which of their columns vary."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from adhesion_jax.effects import EFFECTS
from adhesion_jax.effects.conditions import ANGLES, TEMPERATURES, Calendar, completed_runs
from adhesion_jax.records import Record

#: Fill values of absent columns that are not 1.
_ABSENT = {"normal_load_N": 1e5}

#: The number of columns is padded to a multiple of this, so that different data share a program.
_COLUMNS = 24

#: Conditions that are not columns of the search: others stand for them, as the calendar for time.
_NO_COLUMN = ("time_s", "run_order", "wheel_angle_rad", "slip_ratio", "mode", "lateral_measure")

#: Quantile of the slips that is the reach of the departure, and the least one.
_REACH, _LEAST_REACH = 0.3, 1e-4

#: Braking has a departure of its own if braking and traction have at least this share of the points
#: each. By hand.
_BOTH_BRANCHES = 0.05

#: A column is taken for constant if its range is at most this share of its largest value.
_CONSTANT = 1e-9


# It holds NumPy arrays outside a program and jax arrays inside it (hence `Any`).


class Data(NamedTuple):
    """The measured runs, padded; conditions hold every column that any effect needs."""

    slip: Float[Any, "runs points"]
    adhesion: Float[Any, "runs points"]
    span: Float[Any, " two"]  # of the departure: its reach, and the largest slip of the points
    conditions: Mapping[str, Float[Any, "runs points"]]
    columns: Float[Any, "columns runs points"]  # columns that a term may be a function of


class Problem(NamedTuple):
    """Measured runs as the search takes them."""

    data: Data
    points: np.ndarray  # [runs, points]: the weight of each point, 1 on average; 0: none
    branches: int  # 2 if traction and braking have departures of their own
    bend: float  # prior standard deviation of the first factor of a departure, at most a tenth
    calendar: Calendar
    columns: tuple[str, ...]  # of Data.columns
    flat: Mapping[str, np.ndarray]  # every condition that varies, at the points there are
    constant: frozenset[str]
    blocks: bool  # whether the runs are contiguous blocks of one run, without levels of their own
    in_time: bool  # whether the order of the points of a run is that of time
    measured: frozenset[str]  # columns as given
    named: Mapping[str, tuple[str, ...]]  # the names of the labels of a column, by their numbers
    #: Functions of the columns, [strengths, runs, points], kept once they have been computed.
    terms: dict[tuple[object, ...], np.ndarray]

    def name_of(self, column: str, label: float) -> str:
        """A label as it is in the data: a word, or a number."""
        return self.named[column][int(label)] if column in self.named else f"{label:g}"

    @property
    def runs(self) -> int:
        """The number of runs, without those that pad the arrays."""
        return int((self.points > 0).any(axis=1).sum())


def label_of(column: str, measured: frozenset[str]) -> str:
    """The measured column that a condition stands for."""
    if column in measured:
        return column
    named = {
        "campaign_time": ("time_s", "run"),
        "temperature_C": TEMPERATURES,
        "lateral_measure": ("lateral_creepage", *ANGLES, "curvature_per_m"),
        "wheel_angle_rad": ("position_m",),
    }.get(column, ())
    return next((name for name in named if name in {*measured, "run"}), column)


def prepare(
    record: Record,
    calendar: Calendar,
    blocks: bool,
    worth: np.ndarray,
    named: Mapping[str, tuple[str, ...]],
) -> Problem:
    """The arrays of a record [runs, points] for the search.

    `blocks` says that the runs of the record are blocks of one run. A point has a weight
    proportional to how many rows it is worth.
    """
    record, worth = _padded(record), _enlarged(worth)
    points = np.where(record.mask, worth, 0.0)
    points = points / points[points > 0].mean()
    slip, adhesion = np.asarray(record.slip), np.asarray(record.adhesion)
    whole = dict(conditions_of(record, calendar))
    if blocks and "time_s" not in record.conditions:
        # Blocks of one run without a time have no calendar: they may be ordered by slip.
        whole.pop("campaign_time")
    inside = points > 0
    flat, constant = {}, set()
    for name, values in {**whole, "slip_ratio": np.abs(slip)}.items():
        cells = values[inside]
        if np.ptp(cells) > _CONSTANT * max(float(np.abs(cells).max()), 1e-300):
            flat[name] = cells
        else:
            constant.add(name)
    measured = frozenset(record.conditions)
    # A condition that another one stands for is searched under the other's name. An acceleration
    # that was not measured is the slope of the speed, and thus a consequence of adhesion.
    aliases = {*_NO_COLUMN, *({TEMPERATURES[0], "acceleration_mps2"} - measured)}
    columns = tuple(name for name in flat if name not in aliases)
    sizes = np.abs(slip[inside])
    reach = max(float(np.quantile(sizes, _REACH)), _LEAST_REACH)
    span = np.array([reach, max(float(sizes.max()), 2 * reach)])
    driving = float(np.mean(slip[inside] > 0))
    return Problem(
        _data(slip, adhesion, span, whole, columns),
        points,
        2 if _BOTH_BRANCHES < driving < 1 - _BOTH_BRANCHES else 1,
        1.0,
        calendar,
        columns,
        flat,
        frozenset(constant),
        blocks,
        "time_s" in record.conditions and bool(inside.sum(1).max() > 2),
        measured,
        named,
        {},
    )


def _padded(record: Record) -> Record:
    """The record with masked points and runs more, so that sets of about one size share programs.

    They repeat the last point and the last run.
    """
    mask = _enlarged(np.asarray(record.mask))
    runs, points = record.mask.shape
    mask[runs:], mask[:, points:] = False, False
    slip, adhesion, *others = (
        jnp.asarray(_enlarged(np.asarray(one)))
        for one in (record.slip, record.adhesion, *record.conditions.values())
    )
    inside = jnp.asarray(mask)
    return Record(slip, adhesion, inside, inside, dict(zip(record.conditions, others, strict=True)))


def _enlarged(values: np.ndarray) -> np.ndarray:
    """Runs and points, each up to the next of four sizes an octave."""

    def more(count: int) -> int:
        quantum = max(2 ** (int(np.log2(count)) - 2), 4)
        return -count % quantum

    runs, points = values.shape
    return np.pad(values, ((0, more(runs)), (0, more(points))), mode="edge")


def conditions_of(record: Record, calendar: Calendar) -> Mapping[str, np.ndarray]:
    """Every condition of every run, [runs, points]: measured, or computed from what is measured."""
    measured = {name: np.asarray(values, float) for name, values in record.conditions.items()}
    whole = completed_runs(np.asarray(record.slip), measured, calendar)
    return {name: np.asarray(values) for name, values in whole.items()}


def _data(
    slip: np.ndarray,
    adhesion: np.ndarray,
    span: np.ndarray,
    whole: Mapping[str, np.ndarray],
    columns: Sequence[str],
) -> Data:
    one = np.ones_like(slip)
    # Columns that effects refer to by name. If the data lack such a column it is filled with 1.
    needs = sorted(
        {name for effect in EFFECTS.values() for name in effect.FACTS.needs} | {"time_s"}
    )
    known = {name: whole.get(name, _ABSENT.get(name, 1.0) * one) for name in needs}
    # Time counts from the start of the run: small numbers lose no digits.
    known["time_s"] = known["time_s"] - known["time_s"][:, :1]
    # At least one column is padding, all ones: a term of it changes the whole curve.
    padding = _COLUMNS - len(columns) % _COLUMNS
    stacked = np.stack([*(whole[name] for name in columns), *[one] * padding])
    return Data(slip, adhesion, span, known, stacked)
