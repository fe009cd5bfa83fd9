"""The course of a noisy slip: parabolas through neighbouring rows in the place of the signal."""

from typing import NamedTuple

import numpy as np
from scipy.signal import oaconvolve

from adhesion_jax.data.runs import RunSet
from adhesion_jax.discovery.model.fitting import Fitted, slope_of
from adhesion_jax.discovery.model.noise import courses, slip_noise_of
from adhesion_jax.inference.noise import SlipNoise

#: Numbers of rows through which parabolas are laid.
_WINDOWS = (9, 17, 33, 65, 129, 257)

#: Orders of a parabola, and those of the polynomials that tell whether a slip moves otherwise.
_PARABOLA, _ORDERS = 3, 7

#: Weight of the slip as measured, where that of a parabola that fits is at least 1.
_AS_IT_IS = 1e-3

#: Share of the variance of the noise of adhesion below which a change is too small to matter. By
#: hand.
_NOTICEABLE = 0.05

#: The slip in another unit, which has the same noise.
_VELOCITY = "slip_velocity_mps"


class Course(NamedTuple):
    """Runs with the slip that a search takes, its course or what was measured, and its noise."""

    runs: RunSet
    left: SlipNoise  # of their slip
    measured: RunSet
    noise: SlipNoise  # of the slip as measured: what is taken for it
    p: float  # that adhesion follows the course no better; NaN without one


def size_in_words(noise: SlipNoise) -> str:
    """E.g. `0.03 m/s of a wheel speed`."""
    return f"{noise.sigma:.2g} {'m/s of a wheel speed' if noise.of_wheel_speed else 'of slip'}"


def as_measured(runs: RunSet, given: float | None) -> Course:
    """The slip as it is, and its noise, as `given` or by its course in time."""
    noise = slip_noise_of(runs, given)
    return Course(runs, noise, runs, noise, float("nan"))


def smoothed(course: Course, share: float = 1.0) -> Course:
    """The slip of each row by the parabolas of least squares through it and its neighbours.

    That share of the noise of the slip as measured is taken for noise. The slip is the mean of the
    parabolas of all stretches of 9 to 257 rows that hold the row. The weight of each is exp(-x/2)
    over the variance of its value there, x by how much the squares of four further orders of
    polynomials in it, in units of the noise, exceed the 4 that noise makes: a slip that moves fast
    keeps its course. Nothing is laid over gaps in time, and nothing at all where there is no time,
    or no noise.
    """
    runs, noise, whole = course.runs, course.noise, course.runs.whole
    series = courses(runs) if noise.sigma else []
    if not series:
        return course
    noise = noise._replace(sigma=share * noise.sigma, spread=share * noise.spread)
    slip, spread = whole.slip.copy(), noise.spread.copy()
    for size in {rows.size for rows in series}:
        alike = np.stack([rows for rows in series if rows.size == size])
        slip[alike], spread[alike] = _settled(whole.slip[alike], noise.spread[alike])
    conditions = whole.conditions
    if _VELOCITY in conditions and "vehicle_speed_mps" in conditions:
        velocity = conditions[_VELOCITY]
        moved = (slip - whole.slip) * conditions["vehicle_speed_mps"]
        # It may be told without its sign.
        side = np.where(velocity * whole.slip < 0, -1.0, 1.0)
        conditions = {**conditions, _VELOCITY: velocity + side * moved}
    whole = whole._replace(slip=slip, conditions=conditions)
    return Course(runs._replace(whole=whole), noise._replace(spread=spread), runs, noise, course.p)


def _settled(slip: np.ndarray, spread: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The courses of stretches, [stretches, rows], and about their standard deviations."""
    rows = slip.shape[1]
    weight = np.full(slip.shape, _AS_IT_IS)
    value, left = weight * slip, weight.copy()
    for window in _WINDOWS:
        if window > rows:
            break
        places = np.linspace(-1, 1, window)
        basis = np.linalg.qr(np.vander(places, _ORDERS, increasing=True))[0]
        # Of the windows by their first row: how much of each polynomial there is. One polynomial
        # at a time, since a log may have millions of rows.
        shares = np.stack([_convolved(slip, one[::-1], "valid") for one in basis.T])
        middle = spread[:, window // 2 :][:, : shares.shape[-1]]
        beyond = (shares[_PARABOLA:] ** 2).sum(axis=0) / middle**2 - (_ORDERS - _PARABOLA)
        fits = np.exp(-0.5 * np.maximum(beyond, 0.0))
        variance = (basis[:, :_PARABOLA] ** 2).sum(axis=1)
        weight += _convolved(fits, 1 / variance)
        left += _convolved(fits, 1 / np.sqrt(variance))
        for share, one in zip(shares[:_PARABOLA], basis.T[:_PARABOLA], strict=True):
            value += _convolved(fits * share, one / variance)
    return value / weight, spread * left / weight


def _convolved(rows: np.ndarray, kernel: np.ndarray, mode: str = "full") -> np.ndarray:
    """Each of the rows [stretches, rows] convolved with the kernel."""
    return oaconvolve(rows, kernel[None], mode, axes=-1)


def noticeable(fitted: Fitted, moved: np.ndarray) -> bool:
    """Whether a change of the slip of each point, [points], changes a prediction that matters."""
    setting = fitted.setting
    change = slope_of(fitted)[setting.root > 0] * moved
    return bool(np.mean(change**2) > _NOTICEABLE * setting.sigma**2)


def followed(plain: Fitted, other: Fitted) -> np.ndarray:
    """How much better adhesion follows the slip of another fit, [runs], in log likelihood.

    The squared errors of both are in units of the noise of the first. A slip with less noise gives
    points other weights, which suit noise that grows with the slip whatever the slip is: only the
    predictions count.
    """
    return 0.5 * (plain.setting.root**2 * (plain.error**2 - other.error**2)).sum(axis=1)
