"""From measured runs to the arrays of the compiled program, and which of their columns vary."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions
from adhesion_jax.discovery.model.program import Data
from adhesion_jax.effects import EFFECTS
from adhesion_jax.effects.conditions import ANGLES, TEMPERATURES, Calendar, completed_runs
from adhesion_jax.effects.slip_noise import ExpectedSlip, SlipNoise, expected_slip, of_means
from adhesion_jax.programs import kept
from adhesion_jax.records import Record

#: Columns that effects refer to by name. If the data lack such a column it is filled with 1.
_KNOWN = tuple(sorted({name for effect in EFFECTS.values() for name in effect.NEEDS} | {"time_s"}))

#: Fill values of absent columns that are not 1.
_ABSENT = {"normal_load_N": 1e5}

#: The number of columns is padded to a multiple of this, so that different data share a program.
_COLUMNS = 24

#: Conditions that are not columns of the search: others stand for them, as the calendar for time.
_NO_COLUMN = ("time_s", "run_order", "wheel_angle_rad", "slip_ratio", "mode", "lateral_measure")

#: Number of points of a stretch of a log; whitened, stretches are taken for independent. By hand.
_UNIT_POINTS = 10

#: A column is taken for constant if its range is at most this share of its largest value.
_CONSTANT = 1e-9


class Problem(NamedTuple):
    """Measured runs as the search takes them."""

    data: Data
    points: np.ndarray  # [runs, points]: the weight of each point, 1 on average; 0: none
    worth: np.ndarray  # [runs, points]: how many independent rows each point is worth
    shared: float  # variance of a point that rows share, relative to that of a row
    calendar: Calendar
    columns: tuple[str, ...]  # of Data.columns
    flat: Mapping[str, np.ndarray]  # every condition that varies, at the points there are
    varying: frozenset[str]
    constant: frozenset[str]
    blocks: bool  # whether the runs are contiguous blocks of one run, without levels of their own
    in_time: bool  # whether the order of the points of a run is that of time
    even: bool  # whether every point counts alike: the noise has no correlation and no levels
    measured: frozenset[str]  # columns as given
    units: np.ndarray  # [runs, points]: the number of the independent stretch of each point
    slip_noise: SlipNoise | None  # for which the slip has been corrected
    expected: ExpectedSlip  # the corrected slip with its errors, arrays [runs, points]
    #: Functions of the columns, [runs, points], kept once they have been computed.
    terms: dict[tuple[object, ...], np.ndarray]


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
    slip_noise: SlipNoise | None = None,
    worth: np.ndarray | None = None,
    shared: float = 0.0,
) -> Problem:
    """The arrays of a record [runs, points] for the search, its slip corrected for a noise.

    `blocks` says that the runs of the record are blocks of one run. A point that is worth n
    independent rows has a variance of 1/n + `shared` times that of a row.
    """
    worth = np.ones(record.mask.shape) if worth is None else worth
    points = np.where(record.mask, worth / (1 + shared * worth), 0.0)
    points = points / points[points > 0].mean()
    slip, adhesion = np.asarray(record.slip), np.asarray(record.adhesion)
    nothing = np.zeros((*slip.shape, 2, 2))
    expected = ExpectedSlip(slip, nothing, nothing)
    if slip_noise is not None:
        expected = jax.tree.map(np.asarray, expected_slips(slip_noise, record, worth))
        slip = expected.slip
        record = record._replace(slip=jnp.asarray(slip))
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
    data = _data(slip, adhesion, whole, columns)
    in_time = "time_s" in record.conditions and bool(inside.sum(1).max() > 2)
    return Problem(
        data,
        points,
        worth,
        shared,
        calendar,
        columns,
        flat,
        frozenset(flat),
        frozenset(constant),
        blocks,
        in_time,
        False,
        measured,
        _units(points, blocks and in_time),
        slip_noise,
        expected,
        {},
    )


def _units(points: np.ndarray, short: bool) -> np.ndarray:
    """The unit of each point, [runs, points]: its run, or if `short` a stretch of ten points of it.

    Short units are for blocks of one run in time, whose noise is whitened: the few events of a log
    fill so few blocks that flips of their signs would have no power.
    """
    runs, length = points.shape
    place = np.maximum(np.cumsum(points > 0, axis=1) - 1, 0) // _UNIT_POINTS if short else 0
    return np.arange(runs)[:, None] * length + np.broadcast_to(place, points.shape)


def corrected(problem: Problem, record: Record, slip_noise: SlipNoise | None) -> Problem:
    """The same problem, of the `record` that it was made of, with its slip corrected."""
    return prepare(
        record, problem.calendar, problem.blocks, slip_noise, problem.worth, problem.shared
    )


def expected_slips(slip_noise: SlipNoise, record: Record, worth: np.ndarray) -> ExpectedSlip:
    """The expectation of the true slip given the measured slip, arrays [runs, points].

    The noise is that of one row, and a point is `worth` so many.
    """
    names = ("time_s", slip_noise.falls_with) if slip_noise.falls_with else ("time_s",)
    conditions = {name: jnp.asarray(record.conditions[name]) for name in names}
    arrays = jax.tree.map(jnp.asarray, slip_noise)
    return _expected(arrays, jnp.asarray(record.slip), conditions, jnp.asarray(worth))


@kept()
def _expected(
    slip_noise: SlipNoise,
    slip: Float[Array, "runs points"],
    conditions: Conditions,
    worth: Float[Array, "runs points"],
) -> ExpectedSlip:
    def of_run(slip: Array, conditions: Conditions, worth: Array) -> ExpectedSlip:
        return expected_slip(of_means(slip_noise, worth), slip, conditions)

    return jax.vmap(of_run)(slip, conditions, worth)


def conditions_of(record: Record, calendar: Calendar) -> Mapping[str, np.ndarray]:
    """Every condition of every run, [runs, points]: measured, or computed from what is measured."""
    measured = {name: np.asarray(values, float) for name, values in record.conditions.items()}
    whole = completed_runs(np.asarray(record.slip), measured, calendar)
    return {name: np.asarray(values) for name, values in whole.items()}


def _data(
    slip: np.ndarray,
    adhesion: np.ndarray,
    whole: Mapping[str, np.ndarray],
    columns: Sequence[str],
) -> Data:
    one = np.ones_like(slip)
    known = {name: whole.get(name, _ABSENT.get(name, 1.0) * one) for name in _KNOWN}
    # Time counts from the start of the run: small numbers lose no digits.
    known["time_s"] = known["time_s"] - known["time_s"][:, :1]
    # At least one column is padding, all ones: a term of it changes the whole curve.
    padding = _COLUMNS - len(columns) % _COLUMNS
    stacked = np.stack([*(whole[name] for name in columns), *[one] * padding])
    return Data(slip, adhesion, known, stacked)
