"""Whether one of two speeds of a log is late: by slip and by the time of their accelerations."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.ndimage import correlate1d, maximum_filter1d, minimum_filter1d

from adhesion_jax.data.stretches import jackknife, series_of, stretches, usual_step
from adhesion_jax.wording import plus_minus

#: Delays are sought up to this size, on a grid no finer than this, both in s.
_LONGEST_S, _FINEST_S = 1.0, 0.02

#: Signals are differentiated over this time, in s: a slope in a shorter one is mostly noise.
_SLOPE_S = 0.5

#: At most so many rows are looked at, in this number of contiguous blocks.
_ROWS, _BLOCKS = 200_000, 20

#: The fewest blocks in which something happens whose scatter tells an error.
_FEWEST_BLOCKS = 8

#: A delay is clear where it exceeds one sample and this multiple of its standard error, and one by
#: a correlation where it takes away this share of what that at no delay leaves unexplained.
_ERRORS, _GAIN = 4.0, 0.02

#: Slip is micro-slip, proportional to adhesion, where the adhesion is at most this share of its
#: largest (that of 1 row in 1000), and an event where the slip exceeds this ratio.
_LOW, _EVENT = 0.2, 0.03

#: Below this speed, m/s, or a quarter of the highest, nothing is told of a delay.
_SLOW = 2.0

#: Two ways agree if they differ by no more than this share, or than their errors allow.
_AGREE = 0.25


class Delay(NamedTuple):
    """By how much a first signal is late against a second; negative where it is the other way."""

    seconds: float
    standard_error: float  # by the jackknife over blocks of the log
    clear: bool

    @classmethod
    def told(cls, seconds: float, error: float, step: float) -> "Delay":
        return cls(seconds, error, abs(seconds) > max(step, _ERRORS * error))


class Lateness(NamedTuple):
    """By how much the speed of the vehicle is late against that of the wheel, found in two ways."""

    seconds: float
    standard_error: float
    clear: bool  # in both ways, which agree
    by_accelerations: tuple[float, float]  # the second way, with its standard error


class Grid(NamedTuple):
    """Signals of some stretches at equal times, end to end; arrays [places]."""

    step: float  # s
    stretch: np.ndarray  # the number of the stretch of each place
    block: np.ndarray  # the number of the block of the log of each place
    half: int  # steps before and after a place from which its slope is taken
    signals: Mapping[str, np.ndarray]

    def slope(self, values: np.ndarray) -> np.ndarray:
        """That of a straight line about each place, per s; NaN next to the ends of a stretch."""
        away = np.arange(-self.half, self.half + 1)
        slope = correlate1d(values, away / (self.step * np.sum(away**2)), mode="nearest")
        first, last = (
            end(self.stretch, away.size, mode="constant", cval=-1)
            for end in (minimum_filter1d, maximum_filter1d)
        )
        return np.where(first == last, slope, np.nan)


def best_lag(
    grid: Grid, first: np.ndarray, second: np.ndarray, used: np.ndarray | None = None
) -> Delay:
    """By how much the first of two signals of a grid, [places], is late against the second.

    The lag within 1 s at which their slopes correlate best, with a parabola through it and its
    neighbours; `used` are the places that count. Source: Knapp and Carter 1976, IEEE Trans. ASSP
    24:320-327 (the unweighted estimator); the standard error is that of the jackknife over blocks
    of the log.
    """
    most = round(_LONGEST_S / grid.step)
    slopes = grid.slope(first), grid.slope(second)
    fine = np.isfinite(slopes[0]) & np.isfinite(slopes[1])
    if used is not None:
        fine &= used
    one, other = (np.where(fine, slope, 0.0) for slope in slopes)
    sums = _products(grid, one, other, fine, most)
    whole = sums.sum(axis=0)
    if sums.shape[0] < _FEWEST_BLOCKS or not _top(whole, most)[1] > 0:
        return Delay(0.0, np.inf, False)
    lag, best = _top(whole, most)
    error = jackknife([_top(whole - one, most)[0] for one in sums])
    none = _correlation(whole)[most]
    gain = float((best**2 - none**2) / max(1 - none**2, 1e-12))
    found = Delay.told(lag * grid.step, error * grid.step, grid.step)
    return found._replace(clear=found.clear and gain > _GAIN)


def _products(
    grid: Grid, first: np.ndarray, second: np.ndarray, fine: np.ndarray, most: int
) -> np.ndarray:
    """Sums over the blocks of first(t + lag) second(t) and of both squares, [blocks, 3, lags]."""
    blocks = int(grid.block.max()) + 1
    sums = np.zeros((blocks, 3, 2 * most + 1))
    for place, lag in enumerate(range(-most, most + 1)):
        ahead = slice(max(lag, 0), first.size + min(lag, 0))
        behind = slice(max(-lag, 0), first.size - max(lag, 0))
        both = fine[ahead] & fine[behind] & (grid.stretch[ahead] == grid.stretch[behind])
        one, other = first[ahead] * both, second[behind] * both
        for row, values in enumerate((one * other, one * one, other * other)):
            sums[:, row, place] = np.bincount(grid.block[behind], values, blocks)
    return sums[sums[:, 2, most] > 0]


def _correlation(sums: np.ndarray) -> np.ndarray:
    """The correlation at each lag of sums of products and squares, [3, lags]."""
    return np.asarray(sums[0] / np.sqrt(np.maximum(sums[1] * sums[2], 1e-300)))


def _top(sums: np.ndarray, most: int) -> tuple[float, float]:
    """The lag in steps at which the correlation is largest, and that correlation."""
    level = _correlation(sums)
    place = int(np.clip(np.argmax(level), 1, level.size - 2))
    before, here, after = level[place - 1 : place + 2]
    bend = before - 2 * here + after
    shift = float(np.clip(0.5 * (before - after) / bend, -1, 1)) if bend < 0 else 0.0
    return place - most + shift, float(here - 0.25 * (before - after) * shift)


def grid_of(time: np.ndarray, run: np.ndarray, signals: Mapping[str, np.ndarray]) -> Grid | None:
    """The signals of the stretches of a log at equal times; None if all of them are short.

    `run` tells rows that are not of one course in time apart.
    """
    step, size = max(usual_step(time, run), _FINEST_S), time.size // _BLOCKS
    half = round(_SLOPE_S / step / 2)
    parts = []
    for block in range(_BLOCKS if size and step <= _SLOPE_S / 2 else 0):
        within = slice(block * size, (block + 1) * size)
        for rows in stretches(time[within], run[within]):
            there = time[within][rows]
            if there[-1] - there[0] >= 2 * _LONGEST_S + 2 * _SLOPE_S:
                at = np.arange(there[0], there[-1], step)
                of_part = {n: np.interp(at, there, of[within][rows]) for n, of in signals.items()}
                parts.append(pd.DataFrame({"block": block, **of_part}))
    if not parts:
        return None
    whole = pd.concat(parts, keys=range(len(parts)))
    blocks = np.unique(whole.pop("block"), return_inverse=True)[1]
    stretch = whole.index.get_level_values(0).to_numpy()
    return Grid(step, stretch, blocks, half, {n: whole[n].to_numpy() for n in signals})


def lateness(
    time_s: np.ndarray, vehicle: np.ndarray, wheel: np.ndarray, force: np.ndarray, run: np.ndarray
) -> Lateness | None:
    """By how much the speed of the vehicle is late against that of the wheel; None if untold.

    A speed that is late by T is v(t) - T dv/dt, so that the slip velocity that is computed is

        T dv/dt + k force v + r v + c

    at a small force, where micro-slip is proportional to it (k), with an error r of the radius of
    the wheel. Signals are [rows]: speeds in m/s, or the wheel as a rotation, and force in any unit,
    such as adhesion. The first way is a fit of this where the force is at most 20 % of its largest.
    Its instrument for dv/dt is the acceleration of the wheel, for the noise of a measured dv/dt
    would make T too small (instrumental variables, Reiersol 1945, Arkiv Mat. Astr. Fys. 32A). The
    second is the lag at which the slope of the speed of the vehicle agrees best with that of the
    wheel less the micro-slip k force v, outside of slip events. The delay is that of the first.
    """
    grid = grid_of(time_s, run, {"speed": vehicle, "wheel": wheel, "force": force})
    if grid is None:
        return None
    speed, wheel, force = grid.signals.values()
    size = np.abs(force)
    fast = (speed > max(_SLOW, 0.25 * float(speed.max()))) & (wheel > 0)
    fast &= np.isfinite(grid.slope(speed))
    low = fast & (size <= _LOW * np.quantile(size, 0.999))
    if not low.any():
        return None
    rolled = float(np.median(speed[low] / wheel[low])) * wheel
    micro = fast & (np.abs(rolled - speed) < _EVENT * speed)
    fitted = _by_slip(grid, rolled, low & micro)
    if fitted is None:
        return None
    by_slip, creep = fitted
    near = minimum_filter1d(micro.astype(np.uint8), 4 * grid.half + 1) > 0
    by_lag = best_lag(grid, speed, rolled - creep * force * speed, near)
    apart = abs(by_slip.seconds - by_lag.seconds)
    error = float(np.hypot(by_slip.standard_error, by_lag.standard_error))
    agree = apart <= max(_ERRORS * error, _AGREE * abs(by_slip.seconds))
    return Lateness(*by_slip[:2], by_slip.clear and by_lag.clear and agree, by_lag[:2])


def _by_slip(grid: Grid, rolled: np.ndarray, rows: np.ndarray) -> tuple[Delay, float] | None:
    """T and k of the slip velocity (see `lateness`) from some places of a grid; None if too few.

    `rolled` [places] is the circumferential speed of the wheel.
    """
    speed = grid.signals["speed"]
    slip, further = rolled - speed, (grid.signals["force"] * speed, speed, np.ones(speed.size))
    terms = np.column_stack([grid.slope(speed), *further])
    instruments = np.column_stack([grid.slope(rolled), *further])
    size = np.sqrt(np.mean(terms[rows] ** 2, axis=0))
    if not (size > 0).all():
        return None
    terms, instruments = terms / size, instruments / size
    blocks = [rows & (grid.block == number) for number in range(int(grid.block.max()) + 1)]
    blocks = [one for one in blocks if np.count_nonzero(one) > 4 * size.size]
    if len(blocks) < _FEWEST_BLOCKS:
        return None
    squares = np.array([instruments[one].T @ terms[one] for one in blocks])
    products = np.array([instruments[one].T @ slip[one] for one in blocks])

    def solved(kept: list[int]) -> np.ndarray:
        sums = squares[kept].sum(axis=0), products[kept].sum(axis=0)
        return np.asarray(np.linalg.lstsq(*sums, rcond=1e-10)[0] / size)

    every = list(range(len(blocks)))
    fit = solved(every)
    without = [solved([other for other in every if other != one])[0] for one in every]
    return Delay.told(float(fit[0]), jackknife(without), grid.step), float(fit[1])


def late_signals(
    columns: Mapping[str, np.ndarray], labels: Mapping[str, pd.Categorical]
) -> tuple[str, ...]:
    """A sentence on the speed of a log that seems late, and how to correct it; mostly none.

    `columns` [rows] have the slip velocity as it was computed from two speeds.
    """
    names = ("time_s", "vehicle_speed_mps", "slip_velocity_mps", "adhesion")
    if not {*names} <= {*columns}:
        return ()
    count = columns["time_s"].size
    rows: np.ndarray | slice = slice(None)
    if count > _ROWS:  # blocks of a long log
        begins = np.linspace(0, count - _ROWS // _BLOCKS, _BLOCKS).astype(int)
        rows = (begins[:, None] + np.arange(_ROWS // _BLOCKS)).ravel()
    time, speed, slip, adhesion = (columns[name][rows] for name in names)
    run = series_of(labels, count)[rows]
    found = lateness(time, speed, speed + slip, adhesion, run)
    if found is None or not found.clear:
        return ()
    late, size = ("vehicle", "large") if found.seconds > 0 else ("wheel", "small")
    seconds = f"{abs(found.seconds):.2g}"
    return (
        f"The {late} speed seems late by {plus_minus(abs(found.seconds), found.standard_error)} s "
        "(standard error): at a small force the slip follows the acceleration of the train, and "
        f"the two speeds change together if one is moved by {abs(found.by_accelerations[0]):.2g} "
        f"s. This makes the slip velocity too {size} by {seconds} m/s for each m/s^2 of "
        f"acceleration. Nothing is corrected; to do so add --delay {late}_speed={seconds}.",
    )
