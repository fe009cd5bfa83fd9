"""Signals that are late, moved to the time at which they were."""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from adhesion_jax.data.columns import COLUMNS, UNDECIDED
from adhesion_jax.data.derived import needed
from adhesion_jax.data.gaps import of_rows
from adhesion_jax.data.naming import QUANTITIES, plain
from adhesion_jax.data.stretches import series_of, stretches
from adhesion_jax.errors import InputError
from adhesion_jax.wording import listed

#: What may be late under one word, whichever of these a log has.
_SIGNALS: Mapping[str, tuple[str, ...]] = {
    "force": (*UNDECIDED["force"], "motor_torque_Nm"),
    "load": UNDECIDED["load"],
    "wheel speed": ("wheel_speed_mps", "wheel_rotation_radps"),
}


def without_delays(
    columns: dict[str, np.ndarray],
    labels: Mapping[str, pd.Categorical],
    delays: Mapping[str, float],
) -> tuple[np.ndarray, tuple[str, ...]]:
    """Moves signals to their time, in place; the rows that still have a value, and sentences.

        corrected(t) = recorded(t + delay)

    by linear interpolation between the rows of one run and axle without a gap. The last rows of
    such a stretch have no value, or the first where the delay is negative. `columns` are [rows], by
    quantity; `delays` are in s by quantity or word, such as force. InputError without a time, and
    where no column is what is said to be late.
    """
    if not delays:
        return np.ones(next(iter(columns.values())).size, bool), ()
    time = columns.get("time_s")
    if time is None:
        raise InputError(
            f"the delay of {listed([*delays])} cannot be taken out, because there is no time "
            '(name its column, as by --column "time=COLUMN [s]")'
        )
    late = {
        name: (word, seconds)
        for word, seconds in delays.items()
        for name in _columns_of(word, columns)
    }
    notes = _computed_anew(columns, {*late})
    used = np.ones(time.size, bool)
    series = series_of(labels, time.size)
    for rows in stretches(time, series):
        there = time[rows]
        for name, (_, seconds) in late.items():
            at = there + seconds
            columns[name][rows] = np.interp(at, there, columns[name][rows])
            used[rows] &= (at >= there[0]) & (at <= there[-1])
    said = [
        f"{COLUMNS[name].plain.replace('_', ' ')} is moved by {abs(seconds):g} s to "
        f"{'earlier' if seconds >= 0 else 'later'} times"
        for name, (_, seconds) in late.items()
    ]
    notes += [f"As it was said to be late, the {one}." for one in said]
    if not used.all():
        notes.append(f"{of_rows(~used)} a signal that was moved has no value.")
    return used, tuple(notes)


def _computed_anew(columns: dict[str, np.ndarray], late: set[str]) -> list[str]:
    """Takes out slip and adhesion where their sources are late, to be computed; sentences on it.

    InputError where the slip or the adhesion stands in a column of its own, and cannot be computed
    anew: moving a source of it would change nothing.
    """
    speeds = ("vehicle_speed_mps", *_SIGNALS["wheel speed"])
    notes = []
    for results, sources, what in (
        (("slip_ratio", "slip_velocity_mps"), speeds, "slip"),
        (("adhesion",), (*_SIGNALS["force"], *_SIGNALS["load"]), "adhesion"),
    ):
        there = {*results} & {*columns}
        if not there or there & late or not {*sources} & late:
            continue
        without = {*columns} - there
        if any(f"column {results[0]} " in clause for clause in needed(without)[1]):
            raise InputError(
                f"moving {listed(sorted({*sources} & late))} changes nothing, because the {what} "
                f"stands in a column of its own, {listed(sorted(there))}, and there is not all "
                "that it comes from (name a file with it, or leave out the delay)"
            )
        for name in there:
            del columns[name]
        notes.append(
            f"The {what} is computed anew in the place of {listed(sorted(there))}, because what it "
            "comes from was late."
        )
    return notes


def _columns_of(word: str, columns: Mapping[str, np.ndarray]) -> tuple[str, ...]:
    """The columns that are late under a word; InputError where there is none."""
    called = plain(word)
    names = (word,) if word in COLUMNS else _SIGNALS.get(called, QUANTITIES.get(called, ()))
    if "time_s" in names or (not names and called):
        known = [*(one.replace(" ", "_") for one in _SIGNALS), "vehicle_speed"]
        raise InputError(f"{word} is no signal that may be late (name {listed(known, 'or')})")
    there = tuple(name for name in names if name in columns)
    if not there:
        raise InputError(
            f"the delay of {word} cannot be taken out, because there is no column of it (there "
            f"are {', '.join(sorted(columns))})"
        )
    return there
