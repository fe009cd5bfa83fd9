"""Causes of weather, track and time, as they are planted in simulated runs."""

from collections.abc import Mapping

import numpy as np

from adhesion_jax.effects.drift import Drift
from adhesion_jax.effects.humidity import Humidity
from adhesion_jax.effects.patch import Patch
from adhesion_jax.effects.rail_joint import RailJoint
from adhesion_jax.effects.temperature import Temperature
from adhesion_jax.effects.track_curve import CurveOfTrack
from adhesion_jax.effects.wheel_order import WheelOrder
from adhesion_jax.simulation.planting import (
    CleanRuns,
    OpenEffect,
    Planting,
    by_factor,
    by_its_formula,
    chosen,
    of_strength,
)


def humidity(runs: CleanRuns) -> OpenEffect:
    kinds = ((62.0, 150.0), (35.0, 25.0), (72.0, 8.0))
    centre, width = kinds[runs.generator.integers(len(kinds))]
    reference = runs.middle("relative_humidity_pct")
    return by_its_formula(
        lambda a: Humidity(k=-a, centre=centre, width=width, reference=reference), 0.9, runs
    )


def humidity_otherwise(runs: CleanRuns) -> OpenEffect:
    """1 - a/(1 + exp(-(H - c)/w)), c and w drawn."""
    centre, width = runs.generator.uniform(50.0, 75.0), runs.generator.uniform(5.0, 10.0)
    wet = 1 / (1 + np.exp(-(runs.columns["relative_humidity_pct"] - centre) / width))
    return by_factor(lambda a: 1 - a * wet, 0.95)


def temperature_otherwise(runs: CleanRuns) -> OpenEffect:
    """1 + a u^2, u the temperature over its range, from 0 to 1."""
    celsius = runs.columns["temperature_C"]
    warm = (celsius - celsius.min()) / np.ptp(celsius)
    return by_factor(lambda a: 1 + a * warm**2, 2.0)


def patch(runs: CleanRuns) -> OpenEffect:
    centre = float(np.quantile(runs.columns["position_m"], runs.generator.uniform(0.3, 0.7)))
    width = runs.generator.uniform(50.0, 110.0)
    return by_its_formula(
        lambda depth: Patch(depth=depth, centre=centre, width=width, flatness=2.0), 0.9, runs
    )


def patch_otherwise(runs: CleanRuns) -> OpenEffect:
    """1 - a (1 + cos(pi u))/2, u the distance from the middle over a reach of 70 to 150 m."""
    position = runs.columns["position_m"]
    centre = float(np.quantile(position, runs.generator.uniform(0.3, 0.7)))
    place = np.clip((position - centre) / runs.generator.uniform(70.0, 150.0), -1, 1)
    bump = 0.5 * (1 + np.cos(np.pi * place))
    return by_factor(lambda a: 1 - a * bump, 0.95)


def curve_otherwise(runs: CleanRuns) -> OpenEffect:
    """1 - a |kappa|/(|kappa| + 1/km)."""
    bent = np.abs(runs.columns["curvature_per_m"])
    return by_factor(lambda a: 1 - a * bent / (bent + 1e-3), 0.95)


def wheel_order(runs: CleanRuns) -> OpenEffect:
    order, sine, cosine = (
        float(runs.generator.integers(1, 4)),
        np.sin(runs.phase),
        np.cos(runs.phase),
    )
    return by_its_formula(lambda a: WheelOrder(a * sine, a * cosine, 0.0, 0.0, order), 0.9, runs)


def wheel_order_otherwise(runs: CleanRuns) -> OpenEffect:
    """1 + a (sin(n theta + b) + .3 sin(2 (n theta + b) + 1))."""
    turn = runs.columns["wheel_angle_rad"] * int(runs.generator.integers(1, 4))
    turn = turn + runs.generator.uniform(0, 2 * np.pi)
    return by_factor(lambda a: 1 + a * (np.sin(turn) + 0.3 * np.sin(2 * turn + 1)), 0.7)


def rail_joint(runs: CleanRuns) -> OpenEffect:
    length, sine, cosine = runs.generator.uniform(9.0, 33.0), np.sin(runs.phase), np.cos(runs.phase)
    return by_its_formula(lambda a: RailJoint(a * sine, a * cosine, 0.0, 0.0, length), 0.9, runs)


def rail_joint_otherwise(runs: CleanRuns) -> OpenEffect:
    """Narrow dips at the joints: 1 - a exp(-(u/.15)^2), u the rail lengths from the joint."""
    length = runs.generator.uniform(9.0, 33.0)
    places = runs.columns["position_m"] / length + runs.generator.uniform(0, 1)
    dip = np.exp(-((np.abs(places % 1 - 0.5) / 0.15) ** 2))
    return by_factor(lambda a: 1 - a * dip, 0.95)


def drift(runs: CleanRuns) -> OpenEffect:
    kinds = ((0.5, 3.0), (runs.generator.uniform(0.3, 0.7), 0.03))
    centre, width = kinds[runs.generator.integers(len(kinds))]
    return by_its_formula(
        lambda k: Drift(k=k, centre=centre, width=width, reference=0.5), 0.9, runs
    )


def drift_otherwise(runs: CleanRuns) -> OpenEffect:
    """1 - a (1 - exp(-t/T)), T .3 of the whole time."""
    time = runs.columns["time_s"]
    worn = -np.expm1(-(time - time.min()) / (0.3 * np.ptp(time)))
    return by_factor(lambda a: 1 - a * worn, 0.95)


SURROUNDINGS: Mapping[str, Planting] = {
    "humidity": Planting(humidity, humidity_otherwise),
    "temperature": Planting(of_strength(Temperature, 0.09), temperature_otherwise),
    "patch": Planting(patch, patch_otherwise),
    "curve": Planting(of_strength(CurveOfTrack, 280.0), curve_otherwise),
    "wheel_order": Planting(wheel_order, wheel_order_otherwise, chosen("wheel_angle_rad")),
    "rail_joint": Planting(rail_joint, rail_joint_otherwise),
    "drift": Planting(drift, drift_otherwise),
}
