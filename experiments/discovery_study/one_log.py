"""A log as a locomotive gives it: hardly any slip, a few slip events, slip from wheel speeds."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from adhesion_jax.curves.burckhardt import Burckhardt
from adhesion_jax.errors import InputError
from adhesion_jax.simulation.locomotive_log import LogCourse, burckhardt, dry, falling
from experiments.campaigns.base import misfit, rms
from experiments.campaigns.simulator import SetNoise, SimulatedSet, noisy, table_of

#: Seconds between two points.
_STEP = 0.1

#: Slip ratio between the slip events.
_BASE_SLIP = 0.004

#: Wanted misfit of each effect over the points of the events, in standard deviations of the noise.
_VISIBLE = 1.0

#: Number of points that the longest event needs in a run.
_ROOM = 100


def one_log(
    effects: Sequence[str] = (),
    *,
    seed: int,
    wheel_speed_noise: float = 0.0,
    autocorrelation: float = 0.0,
    sigma: float = 0.008,
    points: int = 3000,
    runs: int = 1,
    events: int = 5,
) -> SimulatedSet:
    """A log at 10 Hz of `runs` runs of `points` points, and a second one of the same rail as test.

    The slip measured is that of a wheel speed with white noise of `wheel_speed_noise` m/s: true
    slip + noise/speed. Adhesion is Burckhardt's with AR(1) noise. Every run has its share of the
    `events`, at least one. A single run has no column `run`.

    Each effect (humidity, sanding, falling_friction) is so strong that it alone leaves a misfit
    of one sigma, rms over the points of the events once the base curve is refitted to them, or as
    strong as it can be; `visible` is that misfit of all effects together.
    """
    for name in effects:
        if name not in LOG_FORMS:
            raise InputError(
                f"There is no effect '{name}' of a log; known are {', '.join(LOG_FORMS)}."
            )
    if points < _ROOM:
        raise InputError(f"A run of {points} points has no room for a slip event; give {_ROOM}.")
    rail = np.random.default_rng((seed, 0))
    level = rail.uniform(0.2, 0.45)
    law = Burckhardt(c1=level, c2=rail.uniform(50.0, 150.0), c3=level * rail.uniform(0.3, 1.2))
    bends = rail.uniform(0.0, 2 * np.pi, 2)
    train, test = (
        _course(runs, points, events, bends, np.random.default_rng((seed, stream)))
        for stream in (1, 2)
    )
    noise = SetNoise(sigma, autocorrelation, 0.0)
    amounts = {name: _amount(name, train, law, sigma) for name in effects}

    def clean(course: LogCourse) -> np.ndarray:
        factors = [LOG_FORMS[name].factor(amount, course) for name, amount in amounts.items()]
        return burckhardt(law, course.slip) * np.prod([np.ones_like(course.slip), *factors], axis=0)

    def measured(course: LogCourse, stream: int) -> tuple[pd.DataFrame, np.ndarray]:
        generator = np.random.default_rng((seed, stream))
        speed = course.columns["vehicle_speed_mps"]
        slip = course.slip + wheel_speed_noise * generator.standard_normal(speed.shape) / speed
        adhesion = noisy(clean(course), noise, generator)
        return table_of(course.columns, slip, adhesion), adhesion

    table, _ = measured(train, 3)
    held_out, adhesion = measured(test, 4)
    truth = clean(test)
    return SimulatedSet(
        train=table,
        test=held_out,
        truth=tuple(effects),
        parameters={name: {"amount": amount} for name, amount in amounts.items()},
        noise=noise,
        base="burckhardt",
        curve=law,
        visible=_visible(law, train, clean(train)) / sigma,
        test_rms_noise=rms(adhesion - truth),
        test_rms_effect=rms(truth.ravel() - burckhardt(law, held_out["slip_ratio"].to_numpy())),
        clean=truth.ravel(),
    )


def _course(
    runs: int, points: int, events: int, bends: np.ndarray, generator: np.random.Generator
) -> LogCourse:
    """Columns and slip of one log; some are drawn for each run, the others drift as over a day."""
    draw = generator.uniform
    clock = _STEP * np.arange(points)
    # The pauses between runs take minutes to hours.
    start = np.concatenate([[0.0], np.cumsum(clock[-1] + draw(300.0, 5000.0, runs - 1))])
    time = np.round(start[:, None] + clock, 1)
    speed = np.clip(draw(6.5, 8.5, (runs, 1)) + _wave(time, 1.5, 100.0, 300.0, generator), 5, 10)
    rolled = np.cumsum(speed * _STEP, axis=1)
    position = draw(0.0, 1000.0, (runs, 1)) + rolled
    slip, event, sanding = _events(runs, points, events, generator)
    apart = 1.0 if runs > 1 else 0.0
    columns = {
        "time_s": time,
        "vehicle_speed_mps": speed,
        "normal_load_N": 110e3
        + apart * draw(-35e3, 35e3, (runs, 1))
        + _wave(time, 400.0, 20.0, 100.0, generator),
        "temperature_C": draw(5.0, 20.0)
        + apart * draw(-8.0, 8.0, (runs, 1))
        + _wave(time, 2.0, 200.0, 600.0, generator),
        "relative_humidity_pct": draw(55.0, 70.0)
        + apart * draw(-22.0, 22.0, (runs, 1))
        + _wave(time, 8.0, 200.0, 600.0, generator),
        "position_m": position,
        # Two curves a kilometre, to either side, with straight track between.
        "curvature_per_m": 1.5e-3 * np.sin(2 * np.pi * position / 1000 + bends[0]) ** 3
        + 0.5e-3 * np.sin(2 * np.pi * position / 410 + bends[1]) ** 3,
        "sanding": sanding.astype(float),
    }
    if runs > 1:
        columns["run"] = np.broadcast_to(np.arange(runs)[:, None], time.shape)
    return LogCourse(slip, event, columns)


def _wave(
    time: np.ndarray, size: float, shortest: float, longest: float, generator: np.random.Generator
) -> np.ndarray:
    """A slow wave of amplitude `size` and a period from `shortest` to `longest` seconds."""
    period, phase = generator.uniform(shortest, longest), generator.uniform(0, 2 * np.pi)
    return size * np.sin(2 * np.pi * time / period + phase)


def _events(
    runs: int, points: int, events: int, generator: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """True slip, whether in an event, whether sand is on; all [runs, points].

    An event is a smooth bump of 4 to 8 s to a slip of .08 to .25; each has a stretch of its run
    for itself. Half of them are sanded, some part of them, and sand is strewn without need too.
    """
    draw = generator.uniform
    each = int(np.clip(events // runs, 1, points // _ROOM))
    clock = np.arange(points)
    slip = np.full((runs, points), _BASE_SLIP)
    event, sanding = np.zeros((2, runs, points), dtype=bool)
    sanded = generator.permutation(runs * each) < (runs * each + 1) // 2
    stretch = points / each
    for number in range(runs * each):
        run, place = divmod(number, each)
        length = draw(40.0, 80.0)
        begin = stretch * place + draw(0.0, stretch - length)
        inside = (clock - begin) / length
        within = (inside > 0) & (inside < 1)
        bump = (draw(0.08, 0.25) - _BASE_SLIP) * np.sin(np.pi * inside) ** 2
        slip[run] += np.where(within, bump, 0.0)
        event[run] |= within
        on = begin + draw(-10.0, 30.0) if sanded[number] else stretch * (place + draw(0.0, 1.0))
        if sanded[number] or draw() < 0.3:
            sanding[run] |= (clock >= on) & (clock < on + draw(20.0, 60.0))
    return slip, event, sanding


def _sanded(amount: float, course: LogCourse) -> np.ndarray:
    """1 + a s, s the share of the contact that has sand: strewn within 1 s, worn off within 4 s."""
    flag = course.columns["sanding"]
    share = np.zeros_like(flag)
    for k in range(1, flag.shape[1]):
        seconds = np.where(flag[:, k] > share[:, k - 1], 1.0, 4.0)
        share[:, k] = share[:, k - 1] + _STEP / seconds * (flag[:, k] - share[:, k - 1])
    return 1 + amount * share


class LogForm(NamedTuple):
    """How an effect is planted in a log."""

    factor: Callable[[float, LogCourse], np.ndarray]  # of adhesion, at an amount
    limit: float  # largest plausible amount; with it the misfit may stay below the wanted one
    also_right: tuple[str, ...]  # other right names: weather only drifts, speed hardly varies


LOG_FORMS: Mapping[str, LogForm] = {
    "humidity": LogForm(dry, 1.0, ("drift", "covariate:time_s", "covariate:campaign_time")),
    "sanding": LogForm(_sanded, 1.0, ()),
    "falling_friction": LogForm(falling, 0.6, ("slip_speed", "contact_heating", "speed")),
}


def _amount(name: str, course: LogCourse, law: Burckhardt, sigma: float) -> float:
    amount = 0.1
    # The misfit is nearly proportional to the amount.
    for _ in range(4):
        clean = burckhardt(law, course.slip) * LOG_FORMS[name].factor(amount, course)
        ratio = _VISIBLE * sigma / _visible(law, course, clean)
        amount = float(min(amount * ratio, LOG_FORMS[name].limit))
    return amount


def _visible(law: Burckhardt, course: LogCourse, clean: np.ndarray) -> float:
    """Rms misfit of the base curve over the points of the events, refitted to these points."""
    return misfit(law, course.slip, clean, {}, course.event)
