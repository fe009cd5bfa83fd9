"""Whether a speed of the train in m/s agrees with what else a log tells of it."""

from collections.abc import Mapping

import numpy as np

#: A speed in km/h over the same in m/s, and the relative deviation up to which a ratio is taken for
#: that.
_KMH, _NEAR = 3.6, 0.15

#: A change of speed, m/s^2, that no train reaches for this time in s, not even by track brakes.
_HARDEST, _FOR_S = 4.0, 2.0

#: Rolling radii of the wheels of rail vehicles, m.
_RADII = (0.2, 0.8)

#: Blocks of rows in which a distance or a change of speed is summed, and the fewest that tell.
_BLOCKS, _FEWEST = 50, 5

#: Changes of speed below this, m/s, say nothing of the unit of an acceleration.
_CHANGED = 0.5


def speed_warnings(columns: Mapping[str, np.ndarray], label: str) -> list[str]:
    """Sentences on the train speed, which is in the column `label`, where its unit must be wrong.

    The first that can be told of: the distance run, by positions; the change of the speed, by an
    acceleration; how fast the speed changes. A train of constant speed whose log has none of these
    tells nothing of the unit.
    """
    speed, time = (columns.get(name) for name in ("vehicle_speed_mps", "time_s"))
    if speed is None or time is None or speed.size < 2:
        return []
    step = np.diff(time)
    usual = np.median(step[step > 0]) if (step > 0).any() else np.inf
    joined = (step > 0) & (step < 10 * usual)  # within a run, and without a gap
    if not joined.any():
        return []
    block = np.arange(step.size) * _BLOCKS // step.size

    def sums(values: np.ndarray) -> np.ndarray:
        return np.bincount(block, np.where(joined, values, 0.0), _BLOCKS)

    if "position_m" in columns:
        run, moved = sums(speed[1:] * step), np.abs(sums(np.diff(columns["position_m"])))
        factor = _typical(run, moved, 1.0)
        if factor is not None:
            return _of_factor(factor, label, "the distance that its positions tell")
    if "acceleration_mps2" in columns:
        changed, told = sums(np.diff(speed)), sums(columns["acceleration_mps2"][1:] * step)
        factor = _typical(changed, told, _CHANGED)
        if factor is not None:
            return _of_factor(factor, label, "the change that its acceleration tells")
    within = max(round(_FOR_S / usual), 1)
    if speed.size <= within:
        return []
    lasted = time[within:] - time[:-within]
    whole = np.isclose(lasted, within * usual, rtol=0.1)
    rate = np.abs(speed[within:] - speed[:-within])[whole] / (within * usual)
    hardest = float(np.quantile(rate, 0.999)) if rate.size else 0.0
    if hardest <= _HARDEST:
        return []
    return [
        f"Check the unit of column {label}: the speed of the train changes by {hardest:.2g} m/s in "
        f"a second, for {_FOR_S:g} s, which no train does (it may be in km/h)."
    ]


def _typical(by_speed: np.ndarray, told: np.ndarray, least: float) -> float | None:
    """The median over blocks of what the speed says, as a multiple of what was told."""
    clear = (np.abs(by_speed) > least) & (told != 0)
    if np.count_nonzero(clear) < _FEWEST:
        return None
    return float(np.median(by_speed[clear] / told[clear]))


def _of_factor(factor: float, label: str, what: str) -> list[str]:
    wrong = wrong_unit(factor)
    if not wrong:
        return []
    return [f"Check the unit of column {label}: it gives {factor:.2g} times {what}, as if {wrong}."]


def wrong_unit(factor: float) -> str:
    """Which units make a speed this multiple of what it is, as a clause; empty where none do."""
    if abs(factor / _KMH - 1) < _NEAR:
        return "km/h were taken for m/s"
    if abs(factor * _KMH - 1) < _NEAR:
        return "m/s were taken for km/h"
    return ""


def radius_warnings(radius: float) -> list[str]:
    """A sentence on a rolling radius in m that was identified, if no rail wheel has it."""
    least, most = _RADII
    if least <= radius <= most:
        return []
    return [
        f"Check the units of train speed and rotation: a rolling radius of {radius:.3g} m is "
        f"unusual for a rail wheel ({least:g} to {most:g} m)."
    ]
