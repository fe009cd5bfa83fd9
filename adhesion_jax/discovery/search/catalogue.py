"""What may be missing: every effect that the columns of a campaign can test, and plain columns."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from adhesion_jax.discovery.model.problem import Problem, label_of
from adhesion_jax.effects import EFFECTS, Covariate, Effect, ShapeTerm, Spline
from adhesion_jax.effects.shape import ACTS_ON

#: Effects that need the order of the points to be that of time.
_HISTORY = "time_s"

#: Effects whose formulas resemble each other: a second one that adds little is a matter of form.
FAMILIES: Mapping[str, str] = {
    **dict.fromkeys(("lag", "delay", "relaxation", "hysteresis", "inertia"), "in time"),
    **dict.fromkeys(
        ("speed", "slip_speed", "falling_friction", "contact_heating"), "slip velocity"
    ),
    "covariate:acceleration_mps2": "load_transfer",
    "covariate:slip_velocity_mps": "slip velocity",
    "covariate:vehicle_speed_mps": "slip velocity",
    **dict.fromkeys(("load_peak", "load_slope", "covariate:normal_load_N"), "load"),
    **dict.fromkeys(("slip_bias", "torque_offset"), "offset"),
    **dict.fromkeys(("patch", "rail_joint", "covariate:position_m"), "place"),
    **dict.fromkeys(("humidity", "covariate:relative_humidity_pct"), "humidity"),
    **dict.fromkeys(("temperature", "covariate:temperature_C"), "temperature"),
    **dict.fromkeys(("drift", "covariate:time_s"), "calendar"),
    **dict.fromkeys(("curve", "lateral_creep", "covariate:curvature_per_m"), "curvature"),
    **dict.fromkeys(("covariate:angle_of_attack_deg", "covariate:lateral_creepage"), "curvature"),
    **dict.fromkeys(("sanding", "covariate:sanding"), "sand"),
    **dict.fromkeys(("axle_position", "covariate:axle"), "axle"),
}

#: The columns an effect rests on beside the slip, where they are not those it needs.
_RESTS_ON: Mapping[str, tuple[str, ...]] = {
    "cleaning": ("slip_ratio", "vehicle_speed_mps", "time_s"),
    "slip_speed": ("slip_ratio", "vehicle_speed_mps"),
    "falling_friction": ("slip_ratio", "vehicle_speed_mps"),
    "contact_heating": ("slip_ratio", "vehicle_speed_mps"),
    "slip_noise": ("slip_ratio",),
    "slip_bias": ("slip_ratio",),
    "torque_offset": ("slip_ratio",),
    "hysteresis": ("slip_ratio", "time_s"),
    "sanding": ("sanding",),
}


class Entry(NamedTuple):
    """One cause, in the forms that are tried first."""

    name: str
    starts: tuple[Effect, ...]
    covariates: tuple[str, ...]
    generic: bool  # a plain column, without a physical cause
    family: str
    acts_on: str = "level"  # of the curve


def library_of(problem: Problem) -> tuple[Entry, ...]:
    """Every entry the campaign can test."""
    entries = [
        entry_of(name, effect.starts(problem.flat), problem)
        for name, effect in EFFECTS.items()
        if name != "slip_noise" and not why_untested(name, problem)
    ]
    for kind in (Covariate, Spline):
        for column in problem.columns:
            entries += column_entries(kind, column, problem)
    return tuple(entry for entry in entries if entry.starts)


def column_entries(kind: type[ShapeTerm], column: str, problem: Problem) -> list[Entry]:
    """A plain column by a form of one column, acting on each part of the curve."""
    name = f"covariate:{label_of(column, problem.measured)}"
    starts = kind.starts({column: problem.flat[column]})
    return [
        entry_of(name, [dataclasses.replace(start, acts_on=acts_on) for start in starts], problem)
        for acts_on in ACTS_ON
        # A function of the slip bends the curve however it acts.
        if acts_on == "level" or column != "slip_velocity_mps"
    ]


def entry_of(name: str, starts: Sequence[Effect], problem: Problem) -> Entry:
    """An entry by its name, with the columns it rests on and its family."""
    if ":" in name:
        covariates = tuple(name.split(":", 1)[1].split("*"))
    else:
        needs = _RESTS_ON.get(name, EFFECTS[name].NEEDS)
        covariates = tuple(dict.fromkeys(label_of(need, problem.measured) for need in needs))
    acts_on = getattr(starts[0], "acts_on", "level") if starts else "level"
    return Entry(name, tuple(starts), covariates, ":" in name, FAMILIES.get(name, name), acts_on)


def why_untested(name: str, problem: Problem) -> str:
    """Empty, or why the campaign says nothing about an effect."""
    needs = EFFECTS[name].NEEDS
    if _HISTORY in needs and not problem.in_time:
        return "acts within a run in time, and the data are no runs in time"
    for need in needs:
        if need in ("time_s", "mode"):
            continue
        if need not in problem.varying and need not in problem.constant:
            return f"needs the column {need}, which is absent"
    varies = [need for need in needs if need in problem.varying and need != "time_s"]
    depends_on_slip = name in _RESTS_ON and "slip_ratio" in _RESTS_ON[name]
    if needs and not varies and not depends_on_slip and name not in ("delay", "lag"):
        constant = next((need for need in needs if need in problem.constant), needs[0])
        return f"needs the column {constant} to vary, which is constant"
    if "slip_ratio" in problem.constant and name in ("slip_bias", "torque_offset", "delay", "lag"):
        return "needs the slip to vary, which is constant"
    return ""
