"""Whether slip and adhesion are of one moment, and how often slip passes a value."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from adhesion_jax.data.exchanged import at_half, roughness
from adhesion_jax.inference.rows import Rows
from adhesion_jax.wording import percent

#: Longest shift that is tried, s, and as a share of the usual run; the share of the roughness, with
#: that beyond chance, and of what noise does not account for, that another moment must take.
_LONGEST_S, _OF_RUN, _SHIFTED, _EXPLAINED = 2.0, 0.25, 0.2, 0.6

#: Most rows by which a shift is judged, and the fewest.
_MOST_ROWS, _FEWEST_ROWS = 200_000, 24

#: Levels of slip whose passages are counted, and how far slip goes beyond one, as shares of the
#: root of the largest slip.
_LEVELS, _BEYOND = (0.35, 0.5, 0.65), 0.1


class Points(NamedTuple):
    """Points of both branches on one side, in their order."""

    slip: Float[np.ndarray, " rows"]
    adhesion: Float[np.ndarray, " rows"]
    residual: Float[np.ndarray, " rows"]
    mean: Float[np.ndarray, " rows"]
    spread: Float[np.ndarray, " rows"]  # standard deviation of the residual by the noise


def shifted(points: Points, rows: Rows, step_s: float | None) -> str:
    """Whether adhesion follows the slip of another moment clearly better than that of its own.

    The roughness of adhesion over the slip of another row is compared, over the same rows, with
    that over its own. Of n points it has a relative error of about 1/sqrt(n); and most of what
    white noise does not account for must be taken, and the points be a curve that rises.
    """
    if not step_s:
        return ""
    slip, adhesion = points.slip[:_MOST_ROWS], points.adhesion[:_MOST_ROWS]
    run = rows.run[: slip.size]
    usual = float(np.median(np.diff(rows.starts)))
    reach = min(round(_LONGEST_S / step_s), int(_OF_RUN * usual))
    # The same rows for every shift: those that have neighbours in their run on both sides.
    inner = np.arange(reach, slip.size - reach)
    inner = inner[run[inner - reach] == run[inner + reach]]
    if reach < 1 or inner.size < _FEWEST_ROWS:
        return ""
    lags = np.unique(np.linspace(-reach, reach, min(2 * reach + 1, 81)).astype(int))
    left = np.array([roughness(slip[inner - lag], adhesion[inner]) for lag in lags])
    at_zero, best = roughness(slip[inner], adhesion[inner]), int(left.argmin())
    lag = int(lags[best])
    clear = at_zero * (_SHIFTED + 1 / np.sqrt(inner.size))
    excess = at_zero - _floor(adhesion, inner)
    if abs(lag) < 2 or at_zero - left[best] < max(clear, _EXPLAINED * excess):
        return ""
    own = np.arange(max(lag, 0), slip.size + min(lag, 0))
    own = own[run[own] == run[own - lag]]
    if not at_half(slip[own - lag], adhesion[own]):
        return ""
    when = "before" if lag > 0 else "after"
    return (
        "Slip and adhesion are not of one moment: adhesion follows the slip of "
        f"{abs(lag) * step_s:.2g} s {when}, about which it scatters "
        f"{percent(1 - left[best] / at_zero)} less; shift the late signal by --delay."
    )


def _floor(values: np.ndarray, inner: np.ndarray) -> float:
    """The roughness that noise alone makes: by second differences in time, as if it were white."""
    low, high = np.quantile(values[inner], [0.01, 0.99])
    bends = np.abs(values[inner - 1] - 2 * values[inner] + values[inner + 1])
    return float(np.mean(bends)) / np.sqrt(3) / max(float(high - low), 1e-300)


def passages(points: Points, rows: Rows) -> int:
    """How often slip passes a value in the order of time, all runs together."""
    place = np.sqrt(points.slip / max(float(np.quantile(points.slip, 0.99)), 1e-300))
    run = rows.run
    counts = []
    for level in _LEVELS:
        beyond = np.abs(place - level) > _BEYOND
        above, of_run = place[beyond] > level, run[beyond]
        counts.append(int(np.sum((above[1:] != above[:-1]) & (of_run[1:] == of_run[:-1]))))
    return max(counts)
