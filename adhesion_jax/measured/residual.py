"""Whether the residual of a measured fit still has structure."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.stats import linregress

from adhesion_jax.inference.fit import MeasuredFit
from adhesion_jax.inference.rows import Rows, evenly, thinned

#: If no peak lies among the points, the slope is taken beyond the slip at which the curve first
#: reaches this share of its largest value at the points.
_SHOULDER = 0.9

#: Largest number of points at which it is looked for.
_MOST_POINTS = 50_000

#: Fewest points beyond the peak for which a slope is given.
_SLOPE_POINTS = 8


class Residual(NamedTuple):
    """Measured adhesion minus the curve, in order of the size of slip, with tests for structure.

    Curves are odd: both signs of a braking point (slip and adhesion negative) are turned. Of a long
    record so many points as are of use, evenly chosen.
    """

    slip: Float[np.ndarray, " points"]  # |slip|, rising
    #: The slip, that of braking points turned: negative only where its noise has turned its sign.
    turned: Float[np.ndarray, " points"]
    adhesion: Float[np.ndarray, " points"]
    braking: Bool[np.ndarray, " points"]
    residual: Float[np.ndarray, " points"]
    #: sqrt(mean(d^2)/2), d the differences of adhesion between neighbours in slip: the noise, if
    #: the curve is straight between neighbours.
    scatter: float
    #: (2 - sum(d^2)/sum(e^2)) over its standard deviation, d the differences of the residual e
    #: between neighbours in slip: standard normal for white noise, large where neighbours are
    #: alike (von Neumann 1941, Ann. Math. Statist. 12:367-395).
    likeness: float
    behind: float  # the slip beyond which the slope is taken
    points_behind: int
    slope: float  # of the residual against slip, beyond the peak; NaN with too few points
    slope_se: float


def residual_structure(fit: MeasuredFit, rows: Rows) -> Residual:
    """The residual of one fit to these rows, in the mean over the true slips."""
    some = thinned(rows, _MOST_POINTS)
    mean, _ = fit.at_rows(some, evenly(rows.slip.size, _MOST_POINTS))
    order = np.argsort(np.abs(some.slip), kind="stable")
    signed, measured = some.slip[order], some.adhesion[order]
    slip, side = np.abs(signed), np.where((signed < 0) & (measured < 0), -1.0, 1.0)
    adhesion = side * measured
    residual = adhesion - side * mean[order]

    points = slip.size
    centred = residual - residual.mean()
    ratio = np.sum(np.diff(centred) ** 2) / max(np.sum(centred**2), np.finfo(float).tiny)
    deviation = 2 * np.sqrt((points - 2) / (points**2 - 1))

    model = adhesion - residual
    top = int(np.argmax(model))
    if slip[top] == slip[-1]:  # no peak of the curve among the points
        top = int(np.argmax(model >= _SHOULDER * model.max()))
    behind = float(slip[top])
    after = slip > behind
    slope, slope_se = np.nan, np.nan
    if after.sum() >= _SLOPE_POINTS and np.ptp(slip[after]) > 0:
        line = linregress(slip[after], residual[after])
        slope, slope_se = float(line.slope), float(line.stderr)
    return Residual(
        slip,
        side * signed,
        adhesion,
        side < 0,
        residual,
        float(np.sqrt(np.mean(np.diff(adhesion) ** 2) / 2)),
        float((2 - ratio) / deviation),
        behind,
        int(after.sum()),
        slope,
        slope_se,
    )


def running_mean(
    slip: Float[np.ndarray, " points"], residual: Float[np.ndarray, " points"], window: int
) -> tuple[Float[np.ndarray, " means"], Float[np.ndarray, " means"]]:
    """Means of `window` neighbours in slip: their slip and their residual."""
    weights = np.full(window, 1 / window)
    return np.convolve(slip, weights, "valid"), np.convolve(residual, weights, "valid")
