"""Speeds that are none: held between updates, or of a wheel whose signal drops out."""

from itertools import pairwise

import numpy as np

from adhesion_jax.data.stretches import longest_step, stretches, usual_step

#: No wheel gains or loses speed faster, in m/s^2: 70 kN turn a wheelset of 420 kg m2 with 60.
ACCELERATION = 60.0

#: A speed that keeps a value for longer, s, was set to it, as on a rig; no receiver is so slow.
LONGEST_HELD_S = 2.0

#: A speed is held if nearly all of its changes, and there are some, lie a multiple of one number of
#: rows apart, most of them change it by more than its last digit, and the wheel turns on meanwhile.
_REGULAR, _FEWEST, _BEYOND_A_DIGIT, _TURNS_ON = 0.95, 20, 0.3, 0.5


def held_for(speed: np.ndarray, wheel: np.ndarray, series: np.ndarray) -> int:
    """Over how many rows each value of a speed, [rows], is held; 0 where each row has its own.

    Steps of a last digit are no changes that are held: they come when the speed passes a digit.
    """
    change = np.diff(speed)
    new = (change != 0) | (np.diff(series) != 0)
    places = np.flatnonzero(new)
    apart = np.diff(places)
    if apart.size < _FEWEST:
        return 0
    rows = int(np.median(apart))
    if rows < 2 or np.mean(apart % rows == 0) < _REGULAR:
        return 0
    digit = np.diff(np.unique(speed)).min(initial=np.inf)
    beyond = np.mean(np.abs(change[change != 0]) > 1.5 * digit)
    turns_on = np.mean(np.diff(wheel)[~new] != 0)
    return rows if beyond >= _BEYOND_A_DIGIT and turns_on >= _TURNS_ON else 0


def between_updates(
    speed: np.ndarray, time: np.ndarray, series: np.ndarray, held: int
) -> tuple[np.ndarray, np.ndarray]:
    """A held speed, [rows], on straight lines between updates, and whether it is known, [rows].

    From a change on it is told every `held` rows, by the same value until it changes. After the
    last update of a stretch it is not known; a stretch without a change is left as it is.
    """
    found, known = speed.copy(), np.ones(speed.size, bool)
    step = usual_step(time, series)
    for rows in stretches(time, series):
        own, at = speed[rows], time[rows]
        change = (1 + np.flatnonzero(np.diff(own))).tolist()
        if not change:
            continue
        # The first value may have been told before the stretch begins.
        begins = [-(-change[0] % held), *change, rows.size]
        told = np.concatenate([np.arange(*ends, held) for ends in pairwise(begins)])
        when = np.where(told < 0, at[0] + told * step, at[np.maximum(told, 0)])
        found[rows] = np.interp(at, when, own[np.maximum(told, 0)])
        known[rows[told[-1] + 1 :]] = False
    return found, known


def dropouts(
    slip_mps: np.ndarray, speed_mps: np.ndarray, time_s: np.ndarray, series: np.ndarray
) -> np.ndarray:
    """Which rows, [rows], bool, have a wheel that stands at once and turns again at once.

    Both are faster than a wheel can be accelerated; at an end of a series one of them is enough.
    """
    stands = np.abs(slip_mps + speed_mps) <= 1e-9 * np.abs(speed_mps).max(initial=0.0)
    within = (np.diff(series) == 0) & (np.diff(time_s) <= longest_step(time_s, series))
    at_once = within & (np.abs(np.diff(slip_mps)) > ACCELERATION * np.diff(time_s))
    number = np.cumsum(np.append(True, (np.diff(stands) != 0) | ~within)) - 1
    first = np.flatnonzero(np.append(True, np.diff(number) != 0))
    # Of each piece: whether it begins, and ends, at once, or where a series does.
    into, begins = np.append(False, at_once)[first], np.append(True, ~within)[first]
    last = np.append(first[1:], slip_mps.size) - 1
    out, ends = np.append(at_once, False)[last], np.append(~within, True)[last]
    sudden = (into | begins) & (out | ends) & (into | out)
    return np.asarray(stands & sudden[number])
