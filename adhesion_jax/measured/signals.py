"""Whether slip and adhesion are what they are called: their unit, their columns, their moment."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from adhesion_jax.inference.grouping import evenly
from adhesion_jax.inference.rows import Rows
from adhesion_jax.wording import percent

#: Bins of slip, and the fewest points of one.
_BINS, _FEWEST = 12, 5

#: Largest adhesions between which a measurement lies.
_STRANGE = (0.003, 10.0)

#: A curve saturates whose medians at half of the largest abscissa are at least this share of their
#: largest. One of two is the function of the other if neighbours by it differ this factor less.
_SATURATED, _SMOOTHER = 0.6, 2.0

#: Longest shift that is tried, s, and as a share of the usual run; the share of the roughness, with
#: that beyond chance, and of what noise does not account for, that another moment must take.
_LONGEST_S, _OF_RUN, _SHIFTED, _EXPLAINED = 2.0, 0.25, 0.2, 0.6

#: Most rows that signals are judged by, and fewest for a shift.
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


def bins_of(slip: Float[np.ndarray, " rows"]) -> list[np.ndarray]:
    """Rows of bins of equal width in the root of slip; one of too few rows joins the next."""
    order = np.argsort(slip, kind="stable")
    place = (_BINS * np.sqrt(slip[order] / max(float(slip.max()), 1e-300))).astype(int)
    groups, begin = [], 0
    for end in np.append(np.flatnonzero(np.diff(place)) + 1, slip.size).tolist():
        if end - begin >= _FEWEST:
            groups.append(order[begin:end])
            begin = end
    return groups


def strange(points: Points) -> str:
    """Whether adhesion is none that a wheel or a tyre has."""
    top = float(np.quantile(np.abs(points.adhesion), 0.99))
    if _STRANGE[0] <= top <= _STRANGE[1]:
        return ""
    return (
        f"Adhesion reaches {top:.2g}, which no wheel has: the unit of the force or of the load is "
        'probably another one; say it, as in --column "axle_force=F [kN]".'
    )


def swapped(points: Points) -> str:
    """Whether slip is a function of adhesion that rises and saturates, and not the other way.

    Adhesion over slip rises within small slips and has one value at each. Where the names are
    exchanged, what is called slip does so over what is called adhesion.
    """
    some = evenly(points.slip.size, _MOST_ROWS)
    slip, adhesion = points.slip[some], points.adhesion[some]
    half = _at_half(adhesion, slip)
    rough = _roughness(slip, adhesion), _roughness(adhesion, slip)
    if half < _SATURATED or rough[0] < _SMOOTHER * rough[1]:
        return ""
    return (
        "Slip and adhesion look exchanged: what is called slip is a function of what is called "
        f"adhesion and reaches {percent(half)} of its largest value at half of the largest "
        f"adhesion, as adhesion does over slip, while at the same slip adhesion differs "
        f"{rough[0] / max(rough[1], 1e-300):.2g} times more; exchange them, as by --column "
        '"slip_ratio=adhesion" --column "adhesion=slip_ratio".'
    )


def _at_half(over: np.ndarray, values: np.ndarray) -> float:
    """The least median of values from half of the largest abscissa on, over that of a bin; or 0.

    0 too where they do not rise from below a half of it, so that there is no curve.
    """
    within = over >= 0
    over, values = over[within], values[within]
    groups = bins_of(over) if over.size else []
    if len(groups) < 4:
        return 0.0
    medians = np.array([np.median(values[group]) for group in groups])
    behind = [np.median(over[group]) >= 0.5 * over.max() for group in groups]
    top = float(medians.max())
    if top <= 0 or medians[0] > 0.5 * top or not any(behind):
        return 0.0
    return float(medians[behind].min()) / top


def _roughness(over: np.ndarray, values: np.ndarray) -> float:
    """The mean difference of values that are neighbours by the abscissa, over their range."""
    low, high = np.quantile(values, [0.01, 0.99])
    steps = np.abs(np.diff(np.clip(values, low, high)[np.argsort(over, kind="stable")]))
    return float(np.mean(steps)) / max(float(high - low), 1e-300)


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
    left = np.array([_roughness(slip[inner - lag], adhesion[inner]) for lag in lags])
    at_zero, best = _roughness(slip[inner], adhesion[inner]), int(left.argmin())
    lag = int(lags[best])
    clear = at_zero * (_SHIFTED + 1 / np.sqrt(inner.size))
    excess = at_zero - _floor(adhesion, inner)
    if abs(lag) < 2 or at_zero - left[best] < max(clear, _EXPLAINED * excess):
        return ""
    own = np.arange(max(lag, 0), slip.size + min(lag, 0))
    own = own[run[own] == run[own - lag]]
    if not _at_half(slip[own - lag], adhesion[own]):
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
