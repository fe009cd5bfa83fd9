"""The noise of measured runs: of the slip, from its course, and of adhesion, from the residual."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy
from jaxtyping import Float, Int

from adhesion_jax.errors import InputError
from adhesion_jax.inference.rows import Rows
from adhesion_jax.inference.sums import Variance

#: Rows of a stretch through which a parabola is drawn, and most stretches that are looked at.
_STRETCH, _MOST_STRETCHES = 15, 20_000

#: A noise below this share of the largest slip, or slip velocity, changes nothing.
_ROUNDING = 1e-6

#: Least vehicle speed by which the noise of a wheel speed is divided, m/s.
_SLOWEST = 0.1

#: The column that the noise of a slip ratio falls with, where it is one of the wheel speed.
SPEED = "vehicle_speed_mps"


class SlipNoise(NamedTuple):
    """White noise of the slip, or of the wheel speed, by which the slip is computed."""

    sigma: float  # standard deviation; 0 for an exact slip
    of_wheel_speed: bool  # then in m/s, and the slip has this over the vehicle speed
    given: bool
    spread: Float[np.ndarray, " rows"]  # standard deviation of the slip of each row


def exact(slip: Float[np.ndarray, " rows"]) -> SlipNoise:
    return SlipNoise(0.0, False, False, np.broadcast_to(0.0, slip.shape))


def slip_noise(
    slip: Float[np.ndarray, " rows"],
    speed: Float[np.ndarray, " rows"] | None,
    courses: Sequence[Int[np.ndarray, " _"]],
    given: float | None,
) -> SlipNoise:
    """The noise that is `given`, or that of stretches of 15 rows about parabolas of least squares.

    `courses` are the rows of each signal in time. The variance is the median over the stretches,
    since in a few of them the slip may jump. It is an upper bound, because a slip that truly jumps
    from row to row looks the same: how much of it acts is judged by the residual (`weighing`).
    Without an order in time there is none to see.
    """
    # To be found it has one size where the speed is constant; one that is given is in m/s.
    moving = speed is not None and (given is not None or bool(np.ptp(speed) > 0))
    per_row = 1 / np.maximum(speed, _SLOWEST) if moving and speed is not None else np.ones(1)
    if given is not None:
        if not 0 <= given < np.inf:
            raise InputError(
                f"slip_noise is a standard deviation, 0 for an exact slip or more, not {given:g}."
            )
        return SlipNoise(given, moving, True, np.broadcast_to(given * per_row, slip.shape))
    firsts = [np.arange(0, rows.size - _STRETCH + 1, _STRETCH // 3) for rows in courses]
    count = sum(one.size for one in firsts)
    if count == 0:
        return exact(slip)
    every, before = -(-count // _MOST_STRETCHES), 0
    chosen = []
    for rows, one in zip(courses, firsts, strict=True):
        chosen.append(rows[one[-before % every :: every, None] + np.arange(_STRETCH)])
        before += one.size
    stretches = (slip / np.broadcast_to(per_row, slip.shape))[np.concatenate(chosen)]
    parabola = np.linalg.qr(np.vander(np.linspace(-1, 1, _STRETCH), 3))[0]
    left = np.sum(stretches**2, axis=1) - np.sum((stretches @ parabola) ** 2, axis=1)
    degrees = _STRETCH - 3
    # The median of chi squared (Wilson and Hilferty 1931, Proc. Natl. Acad. Sci. 17:684-688).
    variance = np.median(np.maximum(left, 0.0)) / (degrees * (1 - 2 / (9 * degrees)) ** 3)
    sigma = float(np.sqrt(variance))
    if sigma <= _ROUNDING * float(np.abs(stretches).max()):
        return exact(slip)
    return SlipNoise(sigma, moving, False, np.broadcast_to(sigma * per_row, slip.shape))


#: Lags at which rows are compared, at most; correlations of neighbours that are tried; times of a
#: slow level that are tried, as numbers of rows, from this to a third of the usual run.
_LAGS, _CORRELATIONS = 24, np.concatenate([np.linspace(0, 0.9, 19), [0.95, 0.975]])
_SLOW = 20

#: Most rows that are compared.
_MOST_ROWS = 200_000


class RunNoise(NamedTuple):
    """The residual is e + level x curve + slope x d.

    e has the standard deviation sigma; the level is the sum of one of each run and one that varies
    slowly within it; d is the independent error of the slip.
    """

    sigma: float
    autocorrelation: float = 0.0  # of e, from row to row
    run_scatter: float = 0.0  # standard deviation of the levels of the runs, relative
    slow_level: float = 0.0  # standard deviation of the slow level, relative
    slow_rows: float = 0.0  # rows after which its correlation has fallen to 1/e
    slip_noise: float = 0.0  # standard deviation of d, or of the noise of the wheel speed

    def spread(
        self,
        design: Float[np.ndarray, " rows"],
        mean: Float[np.ndarray, " rows"],
        by_slip: Float[np.ndarray, " rows"],
    ) -> Float[np.ndarray, " rows"]:
        """The standard deviation of the residual of each row, `by_slip` that of slope x d."""
        level = self.run_scatter**2 + self.slow_level**2
        return np.sqrt(self.sigma**2 / design + level * mean**2 + by_slip**2)


def described(
    rows: Rows,
    residual: Float[np.ndarray, " rows"],
    slope: Float[np.ndarray, " rows"],
    mean: Float[np.ndarray, " rows"],
    variance: Variance,
    slip: SlipNoise,
) -> RunNoise:
    """By the products of residuals at some lags within runs, and between their means.

    The mean product at a lag is sigma^2 r^lag of the noise, plus, times the mean product of the
    curve at that lag, the variance of the slow level times exp(-lag/slow) and that of the levels
    of the runs; non-negative least squares over grids of r and slow. Rows whose noise is mostly
    that of the slip are left out.
    """
    clipped = np.clip(residual, *(3 * np.sqrt(np.median(variance.row())) * np.array([-1, 1])))
    quiet = (slope * variance.spread) ** 2 < variance.sigma**2 / rows.design
    if not rows.ordered:
        scatter = _levels(rows, clipped, mean) if rows.several else 0.0
        return RunNoise(variance.sigma, run_scatter=scatter, slip_noise=slip.sigma)
    length = int(np.median(np.diff(rows.starts)))
    lags = np.unique(np.geomspace(1, max(length // 2, 2), _LAGS).astype(int))
    run = rows.run
    step = max(rows.slip.size // _MOST_ROWS, 1)
    products, curves, counts = [], [], []
    for lag in (0, *lags.tolist()):
        first = np.arange(0, rows.slip.size - lag, step)
        first = first[(run[first] == run[first + lag]) & quiet[first] & quiet[first + lag]]
        counts.append(first.size)
        products.append(float(np.mean(clipped[first] * clipped[first + lag])) if first.size else 0)
        curves.append(float(np.mean(mean[first] * mean[first + lag])) if first.size else 0)
    lag, product, curve = np.append(0, lags), np.array(products), np.array(curves)
    weight = np.sqrt(np.maximum(counts, 1) / np.maximum(lag, 1))
    slow_rows = np.geomspace(_SLOW, max(length / 3, _SLOW + 1), 8)
    best = (np.inf, 0.0, 0.0, np.zeros(3))
    for r in _CORRELATIONS:
        for slow in slow_rows:
            columns = [r**lag, curve * np.exp(-lag / slow)]
            if rows.several:
                columns.append(curve)
            design = np.column_stack(columns) * weight[:, None]
            amounts, misfit = scipy.optimize.nnls(design, product * weight)
            if misfit < best[0] - 1e-12:
                best = (misfit, float(r), float(slow), np.append(amounts, np.zeros(1))[:3])
    _, r, slow, (own, of_slow, of_runs) = best
    return RunNoise(
        float(np.sqrt(own)) if own > 0 else variance.sigma,
        r,
        float(np.sqrt(of_runs)),
        float(np.sqrt(of_slow)),
        slow if of_slow > 0 else 0.0,
        slip.sigma,
    )


def _levels(rows: Rows, residual: np.ndarray, mean: np.ndarray) -> float:
    """The scatter of the levels of runs beyond what independent rows make."""
    cross = np.add.reduceat(residual * mean, rows.starts[:-1])
    size = np.add.reduceat(mean**2, rows.starts[:-1])
    level = cross / size
    own = float(np.mean(residual**2)) * float(np.mean(1 / size))
    return float(np.sqrt(max(float(np.var(level)) * rows.runs / (rows.runs - 1) - own, 0.0)))
