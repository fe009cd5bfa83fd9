"""The log of a Bo'Bo' locomotive with a train, from longitudinal dynamics, and its truth.

Equations, all in SI units, at 100 Hz:
  vehicle   m dv/dt = sum of the adhesion forces of the axles - resistance - brakes of the wagons
  wheelset  (J / r^2) dw/dt = T / r - F with F = mu(s, V) f_axle (1 + level) N and s = (w - v) / v
where w is the speed of the tread, T the motor torque and N the axle load with weight transfer. The
wheelsets are solved implicitly (backward Euler), because micro-slip is a hundred times faster than
a sample. Slip control follows a reference of the slip within the events; elsewhere the driver's
demand acts through a lag.
"""

from dataclasses import dataclass
from math import exp

import numpy as np
import pandas as pd
from scipy.ndimage import uniform_filter1d
from scipy.optimize import brentq, minimize_scalar

Array = np.ndarray

STEP_S = 0.01
GRAVITY = 9.81
AXLES = 4
TRAIN_KG = 560_000.0
AXLE_KG = 21_200.0
INERTIA_KGM2, RADIUS_M = 420.0, 0.611

#: Where the couplers and the pivots take hold, and what they tip: heights and lengths in m.
COUPLER_M, PIVOTS_M, PIVOT_M, WHEELBASE_M = 0.65, 9.9, 0.22, 3.0

#: Share of its adhesion that every axle finds: the first runs on the dirtiest rail.
AXLE_FACTORS = (0.88, 0.95, 0.98, 1.0)

#: level, rate of the rise, share that falls, slip over which it falls, by state of the rail.
RAIL = {"dry": (0.38, 135.0, 0.5, 0.19), "wet": (0.2, 85.0, 0.4, 0.27)}

#: The slow level: its standard deviation, and its correlation time in s.
LEVEL_SD, LEVEL_S = 0.03, 20.0

#: Radar: its delay and the window of its mean in s, and the noise before that in m/s.
DELAY_S, WINDOW_S, RADAR_MPS = 0.2, 0.2, 0.02

#: White noise of the encoder in m/s, and of the force from the motor torque in N.
ENCODER_MPS, FORCE_N = 0.01, 900.0

#: Time from one slip event to the next in s.
CYCLE_S = 160.0

_WHEELSET_KG = INERTIA_KGM2 / RADIUS_M**2


@dataclass(frozen=True)
class Day:
    """The logs of the four axles from the front, what is true, and the true signals.

    `signals` has the columns time_s, speed_mps, adhesion_force_N (of all axles), resistance_N, and
    of every axle tread_mps_i, force_N_i (torque over radius), load_N_i and level (of all).
    """

    axles: tuple[pd.DataFrame, ...]
    truth: dict[str, object]
    signals: pd.DataFrame


def adhesion(slip: float, speed_mps: float, rail: str) -> float:
    """The law: odd in slip, lower the faster the train is."""
    level, rate, share, fall = RAIL[rail]
    size = abs(slip)
    value = level * (1 - exp(-rate * size)) * (share * exp(-size / fall) + 1 - share)
    value *= 1.12 / (1 + 0.0045 * 3.6 * speed_mps)
    return value if slip > 0 else -value


def peak(speed_kmh: float, rail: str, axle: int = 0) -> tuple[float, float]:
    """Slip and size of the largest adhesion that an axle finds at this speed."""
    found = minimize_scalar(
        lambda slip: -adhesion(slip, speed_kmh / 3.6, rail),
        bounds=(1e-3, 0.2),
        method="bounded",
        options={"xatol": 1e-10},
    )
    return float(found.x), float(-found.fun * AXLE_FACTORS[axle])


def locomotive_day(seed: int, seconds: float = 2400.0) -> Day:
    """A day of this length; about one slip event in every CYCLE_S."""
    rng = np.random.default_rng([seed, *b"locomotive_day"])
    rows = round(seconds / STEP_S)
    plan = _plan(rng, rows)
    rho = exp(-STEP_S / LEVEL_S)
    shocks = np.sqrt(1 - rho**2) * LEVEL_SD * rng.standard_normal(rows)
    level = np.empty(rows)
    level[0] = LEVEL_SD * rng.standard_normal()
    for row in range(1, rows):
        level[row] = rho * level[row - 1] + shocks[row]
    signals = _drive(plan, level)
    return Day(_logged(rng, signals, plan.rail), _truth(plan), signals)


def leading_axle(seed: int, seconds: float = 2400.0) -> tuple[pd.DataFrame, dict[str, object]]:
    """The log of the first axle, and what is true."""
    day = locomotive_day(seed, seconds)
    return day.axles[0], day.truth


@dataclass(frozen=True)
class _Plan:
    rail: Array  # "dry" or "wet", a value a row
    demand: Array  # adhesion that the driver asks of every axle
    reference: Array  # slip that slip control follows (rows, axles); NaN outside the events
    brake: Array  # brakes of the wagons, m/s^2
    start_mps: float
    events: tuple[tuple[float, float], ...]  # their times in s


def _plan(rng: np.random.Generator, rows: int) -> _Plan:
    """Accelerate, slip, accelerate, coast and brake, once in a cycle; the rail changes in coasting.

    The brakes are far below what the rail would hold.
    """
    time = STEP_S * np.arange(rows)
    cycles = max(1, round(rows * STEP_S / CYCLE_S))
    length = rows * STEP_S / cycles
    demand, brake = np.zeros(rows), np.zeros(rows)
    reference = np.full((rows, AXLES), np.nan)
    wet_cycles = (np.arange(cycles) + int(rng.integers(3))) % 3 == 2
    rail = np.full(rows, "dry")
    events = []
    for cycle in range(cycles):
        begin = cycle * length
        after = time - begin
        inside = (after >= 0) & (after < length)
        wet = bool(wet_cycles[cycle])
        pull = rng.uniform(0.03, 0.06) if wet else rng.uniform(0.05, 0.1)
        start, lasts = begin + rng.uniform(0.08, 0.2) * length, rng.uniform(10.0, 15.0)
        demand[inside & (after < 0.45 * length)] = pull
        slowing = inside & (after >= 0.75 * length) & (after < rng.uniform(0.9, 0.97) * length)
        demand[slowing] = -rng.uniform(0.02, 0.04)
        brake[slowing] = rng.uniform(0.1, 0.3)
        event = (time >= start) & (time < start + lasts)
        phase = (time[event] - start) / lasts
        for axle in range(AXLES):
            top = rng.uniform(0.05, 0.12)
            shape = np.sin(np.pi * phase) ** rng.uniform(1.5, 2.5)
            reference[event, axle] = 0.004 + (top - 0.004) * shape
        events.append((start, start + lasts))
        if wet:  # from the coasting before, so that an event is on one rail
            rail[(after >= -0.15 * length) & (after < 0.6 * length)] = "wet"
    return _Plan(rail, demand, reference, brake, rng.uniform(10.0, 14.0), tuple(events))


def _transfer(pull: float) -> tuple[float, ...]:
    """Change of the load of every axle in N from the pull of all axles: body and bogies tip."""
    body = pull * COUPLER_M / PIVOTS_M / 2
    bogie = pull / 2 * PIVOT_M / WHEELBASE_M
    return (-body - bogie, -body + bogie, body - bogie, body + bogie)


def _resistance(speed: float) -> float:
    """Of the train in N: rolling, and air."""
    return TRAIN_KG * GRAVITY * 1.3e-3 + 60.0 * speed + 7.0 * speed**2


def _drive(plan: _Plan, level: Array) -> pd.DataFrame:
    """The true signals. The forces of a row are those at its speeds."""
    rows = level.size
    speed = plan.start_mps
    treads, torques, errors = [speed] * AXLES, [0.0] * AXLES, [0.0] * AXLES
    pull, outer, loads = 0.0, 0.0, [AXLE_KG * GRAVITY] * AXLES
    out = np.empty((rows, 3 + 3 * AXLES))
    references, rails = plan.reference.tolist(), plan.rail.tolist()
    for row in range(rows):
        speed = max(speed + STEP_S * (pull - outer) / TRAIN_KG, 4.0)
        loads = [AXLE_KG * GRAVITY + change for change in _transfer(pull)]
        pull = 0.0
        for axle in range(AXLES):
            torque = _torque(
                plan.demand[row] * loads[axle],
                references[row][axle],
                treads[axle] - speed,
                speed,
                torques[axle],
                errors,
                axle,
            )
            scale = loads[axle] * AXLE_FACTORS[axle] * (1 + level[row])
            tread = _tread(treads[axle], torque, scale, speed, rails[row])
            pull += torque - _WHEELSET_KG * (tread - treads[axle]) / STEP_S
            treads[axle], torques[axle] = tread, torque
        outer = _resistance(speed) + plan.brake[row] * TRAIN_KG
        out[row] = (speed, pull, outer, *treads, *torques, *loads)
    kinds = ("tread_mps", "force_N", "load_N")
    names = [f"{kind}_{axle + 1}" for kind in kinds for axle in range(AXLES)]
    signals = pd.DataFrame(out, columns=["speed_mps", "adhesion_force_N", "resistance_N", *names])
    signals.insert(0, "time_s", STEP_S * np.arange(rows))
    return signals.assign(level=level)


def _torque(
    demand: float,
    reference: float,
    slip_mps: float,
    speed: float,
    last: float,
    errors: list[float],
    axle: int,
) -> float:
    """Motor torque over radius in N: the driver's through a lag of 1 s, or slip control's.

    Slip control is proportional and integral in the slip velocity, and begins at the last torque;
    `errors` holds the integral part of every axle.
    """
    if reference != reference:  # not a number: no event
        torque = last + STEP_S * (demand - last) / 1.0
        errors[axle] = torque
        return torque
    error = reference * speed - slip_mps
    errors[axle] += STEP_S * 90_000.0 * error
    return errors[axle] + 45_000.0 * error


def _tread(last: float, torque: float, scale: float, speed: float, rail: str) -> float:
    """The tread's speed after a step: w + h / m' scale mu((w - v) / v) = last + h / m' torque.

    The left side rises with w, as a step is short against the fall of the curve.
    """
    gain = STEP_S / _WHEELSET_KG

    def excess(tread: float) -> float:
        return tread - last - gain * (torque - scale * adhesion(tread / speed - 1, speed, rail))

    guess = last
    for _ in range(12):  # secants from the last speed
        here = excess(guess)
        slope = (excess(guess + 1e-6) - here) / 1e-6
        step = here / slope
        guess -= step
        if abs(step) < 1e-10:
            return guess
    return float(brentq(excess, last - 5.0, last + 5.0, xtol=1e-12))


def _logged(
    rng: np.random.Generator, signals: pd.DataFrame, rail: Array
) -> tuple[pd.DataFrame, ...]:
    """What a logger writes of every axle."""
    rows = len(signals)
    radar = signals["speed_mps"].to_numpy() + RADAR_MPS * rng.standard_normal(rows)
    smooth = uniform_filter1d(radar, round(WINDOW_S / STEP_S) + 1, mode="nearest")
    late = round(DELAY_S / STEP_S)
    told = np.concatenate([np.full(late, smooth[0]), smooth[:-late]])
    return tuple(
        pd.DataFrame(
            {
                "time_s": signals["time_s"].round(2),
                "vehicle_speed_mps": told.round(3),
                "wheel_speed_mps": (
                    signals[f"tread_mps_{axle}"] + ENCODER_MPS * rng.standard_normal(rows)
                ).round(3),
                "axle_force_N": (
                    signals[f"force_N_{axle}"] + FORCE_N * rng.standard_normal(rows)
                ).round(),
                "axle_load_N": signals[f"load_N_{axle}"].round(),
                "rail_state": rail,
            }
        )
        for axle in range(1, AXLES + 1)
    )


def _truth(plan: _Plan) -> dict[str, object]:
    """Parameters, peaks (slip, adhesion) of the first axle by rail and speed in km/h, the rest."""
    return {
        "curve": RAIL,
        "axle_factors": AXLE_FACTORS,
        "peaks": {(rail, kmh): peak(float(kmh), rail) for rail in RAIL for kmh in (40, 60, 80)},
        "delay_s": DELAY_S,
        "window_s": WINDOW_S,
        "inertia_kgm2": INERTIA_KGM2,
        "radius_m": RADIUS_M,
        "static_axle_load_N": AXLE_KG * GRAVITY,
        "train_mass_kg": TRAIN_KG,
        "events_s": plan.events,
    }
