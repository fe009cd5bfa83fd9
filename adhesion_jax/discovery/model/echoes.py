"""Columns that repeat the measured slip, adhesion or force, and are therefore no causes."""

from collections.abc import Mapping

import numpy as np
from scipy.ndimage import minimum_filter1d
from scipy.signal import savgol_filter

from adhesion_jax.data.columns import COLUMNS
from adhesion_jax.discovery.model.fitting import Fitted
from adhesion_jax.wording import percent

#: Rows through which the parabolas are laid whose deviations are compared.
_WINDOW = 9

#: A column repeats a signal if its fast changes explain this share of the variance of the signal's.
_SAME = 0.75

#: A column follows the adhesion if it shares this much of its variance within the runs while the
#: slip, of which a cause knows nothing, makes at least so much of that. By hand.
_CLOSELY, _BY_SLIP = 0.9, 0.5

#: The load follows the force if one line through both explains this share of its variance within
#: the runs, and over all of them.
_FOLLOWS = 0.8


def echoes(fitted: Fitted) -> Mapping[str, str]:
    """Why each such column is no cause, a sentence by the name of the column.

    Motor torque or power goes with adhesion, and the speed of the wheel with slip, not as causes
    but because one was computed from the other. Then even the noise of both is the same: compared
    are the deviations from parabolas through nine neighbours, of which a cause shares only a part.
    A motor current with noise of its own still follows adhesion as the slip moves it, and better
    than the curve. Nor is a load a cause that rises and falls with the force as the slip does: the
    pull moves weight from axle to axle.
    """
    problem = fitted.setting.problem
    data = problem.data
    slip, adhesion = np.asarray(data.slip), np.asarray(data.adhesion)
    load = np.asarray(data.conditions["normal_load_N"])
    speed = np.asarray(data.conditions["vehicle_speed_mps"])
    scales = (1.0, load, load * speed)
    signals = {
        "adhesion": [adhesion * scale for scale in scales],
        "slip": [slip, slip * speed],
    }
    fast = {name: [_fast(fitted, one) for one in some] for name, some in signals.items()}
    inside = problem.points > 0
    curve = [_within(np.asarray(fitted.adhesion) * scale, inside) for scale in scales]
    pulls = [_within(one, inside) for one in signals["adhesion"]]
    swept = _share(curve[0], pulls[0]) > _BY_SLIP
    found = {}
    for place, column in enumerate(problem.columns):
        if column in COLUMNS or column not in problem.measured or column in problem.named:
            continue
        values = np.asarray(data.columns[place])
        # The speed of a wheel is that of the train and the slip velocity together.
        own = [_fast(fitted, values), _fast(fitted, values - speed)]
        for name, some in fast.items():
            if max(_share(one, other) for one in own for other in some) > _SAME:
                found[column] = (
                    f"{column} repeats the {name} row by row, noise and all: one was probably "
                    "computed from the other, so that it is no cause of it. It is left out."
                )
        moves = _within(values, inside)
        followed, best = max((_share(moves, one), at) for at, one in enumerate(pulls))
        closely = followed > max(_CLOSELY, _share(moves, curve[best]))
        if column not in found and swept and closely:
            found[column] = (
                f"{column} follows the adhesion as the slip moves it: {percent(followed)} of their "
                "variance within the runs is common. So does what is computed from the force or "
                "makes it, and no cause of adhesion at a given slip. It is left out."
            )
    if "normal_load_N" in problem.flat and _moved_by(fitted, load, adhesion * load):
        found["normal_load_N"] = (
            "The load rises and falls with the force within the runs, as the pull moves weight "
            "from axle to axle: it is no cause of the adhesion. It is left out."
        )
    return found


def _moved_by(fitted: Fitted, load: np.ndarray, force: np.ndarray) -> bool:
    inside = fitted.setting.problem.points > 0
    if fitted.base == "level":  # where the slip stands still the load may well move the force
        return False
    loads, forces = (_within(one, inside) for one in (load, force))
    if not _share(loads, forces) > _FOLLOWS:
        return False
    left = (load - load[inside].mean() - loads @ forces / (forces @ forces) * force)[inside]
    return bool(np.var(left) < (1 - _FOLLOWS) * np.var(load[inside]))


def _within(values: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """The values less their mean over the run, of the points there are."""
    mean = np.sum(values * inside, axis=1) / np.maximum(inside.sum(axis=1), 1)
    return (values - mean[:, None])[inside]


def _fast(fitted: Fitted, values: np.ndarray) -> np.ndarray:
    """Deviations of the rows from parabolas through their neighbours, of those that have all."""
    if values.shape[1] < _WINDOW:
        return np.zeros(0)
    inside = fitted.setting.problem.points > 0
    whole = minimum_filter1d(inside, _WINDOW, axis=1, mode="constant", cval=0)
    return (values - savgol_filter(values, _WINDOW, 2, axis=1, mode="nearest"))[whole]


def _share(one: np.ndarray, other: np.ndarray) -> float:
    """Share of the variance that two series of mean zero have in common."""
    size = float(one @ one) * float(other @ other)
    return float(one @ other) ** 2 / size if size > 0 else 0.0
