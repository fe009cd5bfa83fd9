"""From runs to what the compiled program takes, and which columns can say anything."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions
from adhesion_jax.discovery.model.program import Data
from adhesion_jax.effects import EFFECTS
from adhesion_jax.effects.conditions import ANGLES, TEMPERATURES, Calendar, completed
from adhesion_jax.effects.slip_noise import ExpectedSlip, SlipNoise, expected_slip
from adhesion_jax.records import Record

#: Conditions that effects know by name; where a campaign lacks one, one stands for it.
_KNOWN = tuple(sorted({name for effect in EFFECTS.values() for name in effect.NEEDS} | {"time_s"}))

#: What an effect takes for a column that is absent and that it can do without, if not one.
_ABSENT = {"normal_load_N": 1e5}

#: Columns are padded to a multiple of this, so that campaigns share a program.
_COLUMNS = 24

#: Conditions that stand in for others: time and order for the calendar, angle for position.
_NO_COLUMN = ("time_s", "run_order", "wheel_angle_rad", "slip_ratio", "mode", "lateral_measure")

#: Points of a stretch of a log that is taken for independent of the others once it is whitened.
_UNIT_POINTS = 10

#: A column is taken for constant where its spread is below this share of its size.
_CONSTANT = 1e-9


class Problem(NamedTuple):
    """A campaign, ready to be explained."""

    data: Data
    points: np.ndarray  # [runs, points]: 1 where there is a point, else 0
    calendar: Calendar
    columns: tuple[str, ...]  # of Data.columns
    flat: Mapping[str, np.ndarray]  # every condition that varies, of the points there are
    varying: frozenset[str]
    constant: frozenset[str]
    blocks: bool  # contiguous blocks of one run, which have no level of their own
    in_time: bool  # whether the order of the points of a run is that of time
    even: bool  # whether every point counts alike: the noise has no correlation and no levels
    measured: frozenset[str]  # columns as given
    units: np.ndarray  # [runs, points]: the numbers of stretches that are taken for independent
    slip_noise: SlipNoise | None  # what the slip has been corrected for
    expected: ExpectedSlip  # that slip, with its errors, arrays [runs, points]
    terms: dict[
        tuple[object, ...], np.ndarray
    ]  # filled as they are asked for: functions of the columns


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
    record: Record, calendar: Calendar, blocks: bool, slip_noise: SlipNoise | None = None
) -> Problem:
    """The problem of a campaign, arrays [runs, points], with its slip corrected for a noise."""
    points = np.asarray(record.mask, float)
    slip, adhesion = np.asarray(record.slip), np.asarray(record.adhesion)
    nothing = np.zeros((*slip.shape, 2, 2))
    expected = ExpectedSlip(slip, nothing, nothing)
    if slip_noise is not None:
        expected = jax.tree.map(np.asarray, expected_slips(slip_noise, record))
        slip = expected.slip
        record = record._replace(slip=jnp.asarray(slip))
    whole = dict(conditions_of(record, calendar))
    if blocks and "time_s" not in record.conditions:
        # Blocks of one run without a time have no calendar: their order may be that of the slip.
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
    # A column that another stands in for is looked at under the other's name. An acceleration that
    # was not measured is the slope of the speed, which adhesion itself brings about.
    aliases = {*_NO_COLUMN, *({TEMPERATURES[0], "acceleration_mps2"} - measured)}
    columns = tuple(name for name in flat if name not in aliases)
    data = _data(slip, adhesion, whole, columns)
    in_time = "time_s" in record.conditions and bool(inside.sum(1).max() > 2)
    return Problem(
        data,
        points,
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
    """Each run a unit; in blocks of one run in time, whose noise is whitened, each ten points.

    The few events of a log fill a few blocks, and the signs of so few say nothing.
    """
    runs, length = points.shape
    place = np.maximum(np.cumsum(points > 0, axis=1) - 1, 0) // _UNIT_POINTS if short else 0
    return np.arange(runs)[:, None] * length + np.broadcast_to(place, points.shape)


def expected_slips(slip_noise: SlipNoise, record: Record) -> ExpectedSlip:
    """The slip of every run to be expected from what was measured, arrays [runs, points]."""
    names = ("time_s", slip_noise.falls_with) if slip_noise.falls_with else ("time_s",)
    conditions = {name: jnp.asarray(record.conditions[name]) for name in names}
    arrays = jax.tree.map(jnp.asarray, slip_noise)
    return _expected(arrays, jnp.asarray(record.slip), conditions)


@eqx.filter_jit
def _expected(
    slip_noise: SlipNoise, slip: Float[Array, "runs points"], conditions: Conditions
) -> ExpectedSlip:
    return jax.vmap(lambda *run: expected_slip(slip_noise, *run))(slip, conditions)


def conditions_of(record: Record, calendar: Calendar) -> Mapping[str, np.ndarray]:
    """Every condition of every run, [runs, points], measured or following from what is."""
    measured = {name: np.asarray(values, float) for name, values in record.conditions.items()}
    whole = jax.vmap(lambda slip, conditions: completed(slip, conditions, calendar))(
        np.asarray(record.slip), measured
    )
    return {name: np.asarray(values) for name, values in whole.items()}


def _data(
    slip: np.ndarray,
    adhesion: np.ndarray,
    whole: Mapping[str, np.ndarray],
    columns: Sequence[str],
) -> Data:
    one = np.ones_like(slip)
    known = {name: whole.get(name, _ABSENT.get(name, 1.0) * one) for name in _KNOWN}
    # Rates and windows are of the run: small numbers lose no digits.
    known["time_s"] = known["time_s"] - known["time_s"][:, :1]
    # At least one column of ones, which a change of the whole curve acts through.
    padding = _COLUMNS - len(columns) % _COLUMNS
    stacked = np.stack([*(whole[name] for name in columns), *[one] * padding])
    return Data(slip, adhesion, known, stacked)
