"""Conditions computed from the measured columns of a run: other names, rates and the calendar."""

from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from adhesion_jax.curves import Conditions, Scalar
from adhesion_jax.effects.api import Signal
from adhesion_jax.effects.dynamic import has_history, smoothed, steps
from adhesion_jax.programs import kept
from adhesion_jax.records import Record

#: Wheel radius in m by which an angle follows from the rolled distance if none was measured.
NOMINAL_RADIUS = 0.46

#: Width in s of the smoothing of a speed whose slope is taken as the acceleration.
_ACCELERATION_WIDTH = 0.5

#: Columns that can replace each other; the first one in the data is used.
TEMPERATURES = ("temperature_C", "rail_temperature_C", "tread_temperature_C")
ANGLES = ("angle_of_attack_deg", "slip_angle_deg")


class Calendar(NamedTuple):
    """The time axis of a campaign: campaign_time is 0 at `start` and 1 at `end` of `column`."""

    column: str  # time_s, or run_order where time starts anew with each run
    start: Scalar
    end: Scalar


def calendar_of(record: Record) -> Calendar:
    """The calendar of a campaign, arrays [runs, points]."""
    if "time_s" in record.conditions:
        time = np.asarray(record.conditions["time_s"])
        span = np.ptp(time)
        # If time starts anew in every run, the times of the runs overlap.
        if time.shape[0] > 1 and np.ptp(time[:, 0]) > 0.5 * span > 0:
            return Calendar("time_s", float(time.min()), float(time.max()))
    order = np.asarray(record.conditions["run_order"])
    return Calendar("run_order", float(order.min()), float(max(order.max(), order.min() + 1)))


def completed(
    slip: Signal, measured: Conditions, calendar: Calendar
) -> Mapping[str, Float[Array, "..."]]:
    """The conditions of one run, or one steady state, with those that follow from them."""
    conditions = {name: jnp.asarray(values) for name, values in measured.items()}
    if calendar.column in conditions:
        span = calendar.end - calendar.start
        conditions["campaign_time"] = (conditions[calendar.column] - calendar.start) / span
    if has_history(measured):
        conditions.setdefault("run_time_s", conditions["time_s"] - conditions["time_s"][0])
    for name in TEMPERATURES:
        if name in conditions:
            conditions.setdefault("temperature_C", conditions[name])
    if "vehicle_speed_mps" in conditions:
        speed = conditions["vehicle_speed_mps"]
        conditions["slip_velocity_mps"] = jnp.abs(slip) * speed
        if has_history(measured):
            smooth = smoothed(speed, conditions["time_s"], _ACCELERATION_WIDTH)
            conditions.setdefault("acceleration_mps2", smooth[1])
            rolled = jnp.cumsum(speed * (1 + slip) * steps(conditions))
            conditions.setdefault("wheel_angle_rad", rolled / NOMINAL_RADIUS)
    conditions.setdefault("mode", jnp.sign(slip))
    lateral = [jnp.tan(jnp.deg2rad(conditions[name])) for name in ANGLES if name in conditions]
    if "lateral_creepage" in conditions:
        conditions["lateral_measure"] = conditions["lateral_creepage"]
    elif lateral:
        conditions["lateral_measure"] = lateral[0]
    elif "curvature_per_m" in conditions:
        conditions["lateral_measure"] = conditions["curvature_per_m"]
    return conditions


def completed_runs(
    slip: Float[ArrayLike, "runs points"],
    measured: Mapping[str, Float[ArrayLike, "runs points"]],
    calendar: Calendar,
) -> dict[str, Float[Array, "runs points"]]:
    """`completed` of every run of a campaign."""
    found: dict[str, Array] = _completed_runs(slip, measured, *calendar)
    return found


@kept(static=(2,))
def _completed_runs(
    slip: Float[ArrayLike, "runs points"],
    measured: Mapping[str, Float[ArrayLike, "runs points"]],
    column: str,
    start: Scalar,
    end: Scalar,
) -> Mapping[str, Float[Array, "runs points"]]:
    calendar = Calendar(column, start, end)
    return jax.vmap(lambda slip, measured: completed(slip, measured, calendar))(slip, measured)
