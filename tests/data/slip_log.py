"""Slip events of a locomotive whose radar is late and whose wheelsets have inertia."""

import numpy as np
import pandas as pd
from scipy.optimize import least_squares

INERTIA, RADIUS, LOAD, RADAR_LATE = 420.0, 0.611, 21.2e3 * 9.80665, 0.2
TRAIN, RESISTANCE, SPEED = 400e3, 0.05, 60 / 3.6


def curve(slip):
    """Adhesion at 60 km/h: dry rail, with the slope of micro-slip of 150 and a fall after it."""
    level = 0.86 * 1.12 / (1 + 0.0045 * 60) * 0.37
    return level * (1 - np.exp(-150 * np.abs(slip))) * (0.55 * np.exp(-np.abs(slip) / 0.22) + 0.45)


def slip_events(seed, events=12, step=0.05, late=RADAR_LATE, inertia=INERTIA, rise_s=(2.0, 4.0)):
    """The table that the logger writes: time, two speeds, force of an axle, load of an axle.

    Twelve events, one in 12 s: slip rises to 10 % in 2 to 4 s, and falls in 0.8 to 1.2 s as the
    torque is taken away; between them it is 0.2 to 0.4 %. The train of 400 t has four such axles,
    and starts each event at about 60 km/h. The force is that of the torque of the motor: adhesion x
    load + inertia x d(rotation)/dt / radius. Noise: 0.005 m/s of both speeds, 1 % of the force.
    """
    chance = np.random.default_rng(seed)
    fine = 0.005
    time = np.arange(0.0, 12.0, fine)
    tables = []
    for event in range(events):
        begin, rise, fall = 4.0, chance.uniform(*rise_s), chance.uniform(0.8, 1.2)
        base = chance.uniform(0.002, 0.004)
        up = np.clip((time - begin) / rise, 0, 1)
        down = np.clip((time - begin - rise) / fall, 0, 1)
        slip = base + (0.1 - base) * (up**2 * (3 - 2 * up)) * (1 - down**2 * (3 - 2 * down))
        adhesion = curve(slip)
        speed = SPEED - 1 + np.cumsum(fine * (4 * LOAD * adhesion / TRAIN - RESISTANCE))
        wheel = speed * (1 + slip)
        force = LOAD * adhesion + inertia / RADIUS**2 * np.gradient(wheel, fine)
        kept = np.arange(1.0, 11.9, step)
        tables.append(
            pd.DataFrame(
                {
                    "time_s": kept + 100 * event,
                    "vehicle_speed_mps": np.interp(kept - late, time, speed),
                    "wheel_speed_mps": np.interp(kept, time, wheel),
                    "axle_force_N": np.interp(kept, time, force),
                    "axle_load_N": LOAD,
                    "run": event,
                }
            )
        )
    table = pd.concat(tables, ignore_index=True)
    rows = len(table)
    table["vehicle_speed_mps"] += chance.normal(0, 0.005, rows)
    table["wheel_speed_mps"] += chance.normal(0, 0.005, rows)
    table["axle_force_N"] *= 1 + chance.normal(0, 0.01, rows)
    return table


def burckhardt_peak(slip, adhesion):
    """Largest adhesion of the curve c1 (1 - exp(-c2 s)) - c3 s by least squares, and its slip."""

    def missed(c):
        return c[0] * (1 - np.exp(-c[1] * slip)) - c[2] * slip - adhesion

    c = least_squares(missed, [0.3, 100.0, 0.5], x_scale=[0.3, 100.0, 0.5]).x
    at = np.log(c[0] * c[1] / c[2]) / c[1]
    return c[0] * (1 - np.exp(-c[1] * at)) - c[2] * at, at
