"""The runs of a simulated set before any adhesion: excitation, track, weather, vehicle."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from adhesion_jax.curves import Curve
from adhesion_jax.curves.burckhardt import Burckhardt
from adhesion_jax.curves.exponential import Exponential
from adhesion_jax.curves.kiencke import Kiencke
from adhesion_jax.curves.polach import PolachFalling

#: Seconds between two points.
STEP = 0.1

_DAY = 86400.0
_WHEEL_RADIUS = 0.46  # m
_TRACK = 1000.0  # m

#: Smallest slip ratio of every excitation; below it adhesion shows the initial slope alone.
_SLIP_LOW = 0.005

Columns = dict[str, np.ndarray]

#: Draws uniform numbers between two.
Draw = Callable[[float, float], float]


class Runs(NamedTuple):
    """The true slip and columns of each point, [runs, points]; braking runs have negative slip."""

    slip: np.ndarray  # ratio
    columns: Columns  # every other column of the table, and those that only effects ask for


def _burckhardt(level: float, _: float, draw: Draw) -> Curve:
    return Burckhardt(c1=level, c2=draw(50.0, 150.0), c3=level * draw(0.3, 1.2))


def _kiencke(level: float, peak: float, draw: Draw) -> Curve:
    slope = level / peak * draw(2.5, 5.0)
    p1 = slope / level - 2 / peak
    return Kiencke(a0=slope, p1=p1, p2=1 / peak**2, free=("a0", "p1", "p2"))


def _falling(level: float, _: float, draw: Draw) -> Curve:
    share, decay = draw(0.35, 0.65), draw(0.2, 0.6)
    stiffness, k_s = draw(80.0, 200.0), draw(0.25, 0.6)
    return PolachFalling(mu0=1.2 * level, a=share, b=decay, stiffness=stiffness, k_s=k_s)


def _exponential(level: float, _: float, draw: Draw) -> Curve:
    return Exponential(a=draw(1.0, 4.0), b=draw(60.0, 180.0), c=1.1 * level)


#: A random curve of about this largest adhesion, at about this slip if possible, by its form.
DRAWN: dict[str, Callable[[float, float, Draw], Curve]] = {
    "burckhardt": _burckhardt,
    "kiencke": _kiencke,
    "polach-falling": _falling,
    "exponential": _exponential,
}

#: The base curves in turn.
BASE_CURVES = (*DRAWN,)


def draw_curve(name: str, generator: np.random.Generator) -> Curve:
    """A dry or wet rail: adhesion up to .1 to .5, its peak at a slip of about .02 to .05."""
    draw = generator.uniform
    return DRAWN[name](draw(0.15, 0.45), draw(0.02, 0.05), draw)


def draw_runs(runs: int, points: int, operational: bool, generator: np.random.Generator) -> Runs:
    """Runs over one track and a calendar of five days, in the order of time.

    Designed: every condition is drawn on its own. Operational: temperature, humidity and the age
    of the rail follow the calendar, so that they can hardly be told apart; loads are within 4 %.
    """
    clock = STEP * np.arange(points)
    starts = np.sort(generator.uniform(0.0, 5 * _DAY, runs)) + 120.0 * np.arange(runs)
    time = np.round(starts - starts[0], 1)[:, None] + clock
    speed = _speed(clock, runs, generator)
    slip = _slip(clock, runs, generator)
    rolled = np.cumsum(speed, axis=1) * STEP
    first = generator.uniform(0.0, np.maximum(_TRACK - rolled[:, -1], 100.0))
    position = first[:, None] + rolled
    columns: Columns = {
        "time_s": time,
        "run": np.broadcast_to(np.arange(runs)[:, None], time.shape),
        "vehicle_speed_mps": speed,
        "position_m": position,
        "curvature_per_m": _curvature(position, generator),
        "gradient_permille": _gradient(position, generator),
        "sanding": _sanding(clock, runs, generator),
        **_weather(time, operational, generator),
        "axle": np.broadcast_to(generator.permutation(runs)[:, None] % 4 + 1.0, time.shape),
        "angle_of_attack_deg": _wander(clock, runs, 0.8, 0.4, generator),
        "wheel_angle_rad": np.cumsum(speed * (1 + slip), axis=1) * STEP / _WHEEL_RADIUS,
        "groove_depth_um": generator.uniform(20.0, 80.0, (runs, 1))
        + _wander(clock, runs, 0.0, 12.0, generator),
    }
    return Runs(slip, columns)


def _speed(clock: np.ndarray, runs: int, generator: np.random.Generator) -> np.ndarray:
    mean = generator.uniform(7.0, 23.0, (runs, 1))
    swing = generator.uniform(-0.25, 0.25, (runs, 1)) * mean
    ripple = _wander(clock, runs, 0.0, 0.4, generator)
    return np.maximum(mean + swing * (2 * clock / clock[-1] - 1) + ripple, 2.0)


def _slip(clock: np.ndarray, runs: int, generator: np.random.Generator) -> np.ndarray:
    """Slip [runs, points]: one to three sweeps from .005 to .06 or up to .16, waves or ramps."""
    phase = clock / clock[-1]
    sweeps = generator.uniform(1.0, 3.2, (runs, 1))
    shift = generator.uniform(0.0, 1.0, (runs, 1))
    wave = np.cos(2 * np.pi * (sweeps * phase + shift))
    ramp = 2 / np.pi * np.arcsin(0.98 * wave) / (2 / np.pi * np.arcsin(0.98))
    shape = np.where(generator.random((runs, 1)) < 0.5, wave, ramp)
    second = generator.uniform(0.0, 0.3, (runs, 1))
    faster = np.cos(2 * np.pi * (2.3 * sweeps * phase + generator.uniform(0, 1, (runs, 1))))
    mixed = shape + second * faster
    low, high = mixed.min(axis=1, keepdims=True), mixed.max(axis=1, keepdims=True)
    # The power dwells at small slips, where the curve is steep.
    unit = ((mixed - low) / (high - low)) ** 1.4
    size = _SLIP_LOW + (generator.uniform(0.06, 0.16, (runs, 1)) - _SLIP_LOW) * unit
    braking = generator.permutation(runs) < round(0.3 * runs)
    return np.where(braking[:, None], -size, size)


def _curvature(position: np.ndarray, generator: np.random.Generator) -> np.ndarray:
    """Three curves of 400 to 1500 m radius with transitions of some 20 m, straight between."""
    total = np.zeros_like(position)
    for centre in (200.0, 520.0, 820.0):
        middle = centre + generator.uniform(-40.0, 40.0)
        half = generator.uniform(50.0, 100.0)
        radius = generator.choice([-1.0, 1.0]) * generator.uniform(400.0, 1500.0)
        inside = np.tanh((position - middle + half) / 20) - np.tanh((position - middle - half) / 20)
        total += inside / (2 * radius)
    return total


def _gradient(position: np.ndarray, generator: np.random.Generator) -> np.ndarray:
    """Slope of the track in per mille, between -15 and 15."""
    first, second = generator.uniform(0, 2 * np.pi, 2)
    return 10 * np.sin(2 * np.pi * position / 610 + first) + 5 * np.sin(
        2 * np.pi * position / 270 + second
    )


def _sanding(clock: np.ndarray, runs: int, generator: np.random.Generator) -> np.ndarray:
    """Sand for 2 to 5 s once in every other run."""
    begin = generator.uniform(0.1, 0.6, (runs, 1)) * clock[-1]
    end = begin + generator.uniform(0.1, 0.25, (runs, 1)) * clock[-1]
    sands = generator.permutation(runs)[:, None] < runs / 2
    return (sands & (clock >= begin) & (clock < end)).astype(float)


def _weather(time: np.ndarray, operational: bool, generator: np.random.Generator) -> Columns:
    runs = len(time)
    clock = time[0] - time[0, 0]
    if operational:
        days = time / _DAY
        warmth = 0.6 * np.sin(2 * np.pi * (days - 0.3)) + 0.5 * (days / days.max() - 0.5)
        temperature = 11 + 8 * warmth + generator.normal(0, 0.4, (runs, 1))
        humidity = 70 - 22 * warmth + generator.normal(0, 1.0, (runs, 1))
        age = 20 + days
        load = 1e5 * (1 + 0.04 * generator.uniform(-1, 1, (runs, 1)))
    else:
        temperature = generator.uniform(-3, 32, (runs, 1))
        humidity = generator.uniform(25, 98, (runs, 1))
        age = generator.uniform(0.5, 200, (runs, 1)) + 0 * time
        load = generator.uniform(65e3, 130e3, (runs, 1))
    return {
        "normal_load_N": load + _wander(clock, runs, 0.0, 40.0, generator),
        "temperature_C": temperature + _wander(clock, runs, 0.0, 0.05, generator),
        "relative_humidity_pct": np.clip(
            humidity + _wander(clock, runs, 0.0, 0.5, generator), 20.0, 100.0
        ),
        "rail_age_days": age,
    }


def _wander(
    clock: np.ndarray,
    runs: int,
    between: float,
    within: float,
    generator: np.random.Generator,
) -> np.ndarray:
    """Smooth in time: a level drawn by run and a slow wave about it, spreads as given."""
    level = between * generator.standard_normal((runs, 1))
    period = generator.uniform(6.0, 15.0, (runs, 1))
    phase = generator.uniform(0, 2 * np.pi, (runs, 1))
    return level + within * np.sqrt(2) * np.sin(2 * np.pi * clock / period + phase)
