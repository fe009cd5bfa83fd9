"""What forbids an answer: each is one sentence that a glance at the figure would make."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.stats import norm

from adhesion_jax.inference.fit import MeasuredFit
from adhesion_jax.inference.rows import Rows
from adhesion_jax.inference.sums import residuals
from adhesion_jax.measured.answer import Answer, Estimate
from adhesion_jax.measured.comparison import Comparison
from adhesion_jax.wording import percent

#: Bins of slip, the fewest points of one, and the most that count as independent; medians differ
#: that are this multiple of their errors apart.
_BINS, _FEWEST, _TELLING, _APART = 12, 5, 12, 4.5

#: Least share of the largest adhesion by which the curve rises among the points.
_RISE = 0.1

#: A fall behind the peak is seen if it exceeds this multiple of its standard error.
_FALL = 2.0

#: A median residual beyond this share of the largest adhesion and three standard
#: errors is passed by. Share of the points that may lie above the interval beyond what noise makes.
_PASSED, _ABOVE = 0.1, 0.1

#: Longest shift that is tried, s, and the share of what is left over which another moment takes.
_LONGEST_S, _SHIFTED = 2.0, 0.2

#: Most rows that a shift is judged by, and bins of slip for it.
_MOST_ROWS, _SHIFT_BINS = 200_000, 30

#: Largest adhesions between which a measurement lies.
_STRANGE = (0.003, 10.0)

#: A largest adhesion whose ends are further apart than this factor is not known.
_WIDEST = 2.0


class Judgement(NamedTuple):
    """What may be said of the peak; with a veto no number stands for the largest adhesion."""

    vetoes: tuple[str, ...]
    at_least: Estimate | None  # the largest adhesion among the points, where no peak is seen
    why: str  # no peak is seen; empty where one is


class _Turned(NamedTuple):
    """Points of both branches on one side, in their order."""

    slip: Float[np.ndarray, " rows"]
    adhesion: Float[np.ndarray, " rows"]
    residual: Float[np.ndarray, " rows"]
    mean: Float[np.ndarray, " rows"]
    spread: Float[np.ndarray, " rows"]  # standard deviation of the residual by the noise


def judged(
    fits: Mapping[str, MeasuredFit],
    answer: Answer,
    rows: Rows,
    step_s: float | None,
    branches: Comparison | None,
) -> Judgement:
    """The vetoes, by the curve that has most weight; `step_s` is the usual time between rows."""
    fit = fits[max(answer.weights, key=lambda name: answer.weights[name])]
    nothing = np.broadcast_to(0.0, rows.slip.shape)
    left, slope, mean = residuals(rows, fit.law.curve, fit.law.parameters, fit.law.span, nothing)
    side = np.where(rows.slip < 0, -1.0, 1.0)
    noise = np.sqrt(fit.noise.sigma**2 / rows.design + (slope * fit.slip_spread) ** 2)
    points = _Turned(np.abs(rows.slip), side * rows.adhesion, side * left, side * mean, noise)
    found = [_strange(points), *_shifted(points, rows, step_s)]
    if not any(found):
        found.append(_independent(points) or _no_rise(points, fit) or _passed_by(points, fit))
    if np.all(fit.held):
        found.append("Every parameter of the curve is held at a bound or has no influence.")
    if branches is not None and (branches.changed or branches.bent):
        found.append(_two_branches(branches))
    if not any(found):
        found += [_above(points, answer), _wide(answer)]
    vetoes = tuple(dict.fromkeys(filter(None, found)))
    at_least, why = _reached(points, fit, answer) if not vetoes else (None, "")
    return Judgement(vetoes, at_least, why)


def _two_branches(branches: Comparison) -> str:
    table = branches.table.set_index("branch")["mu_max"]
    how = "level" if branches.changed else "course over slip"
    return (
        f"Traction and braking are no one curve: their {how} differs (p = "
        f"{min(branches.p, branches.p_shape):.1g}; under one curve the largest adhesion would be "
        f"{table['traction']:.4f} in traction and {table['braking']:.4f} in braking); identify "
        "each by itself."
    )


def _strange(points: _Turned) -> str:
    """Whether adhesion is none that a wheel or a tyre has."""
    top = float(np.quantile(np.abs(points.adhesion), 0.99))
    if _STRANGE[0] <= top <= _STRANGE[1]:
        return ""
    return (
        f"Adhesion reaches {top:.2g}, which no wheel has: the unit of the force or of the load is "
        'probably another one; say it, as in --column "axle_force=F [kN]".'
    )


def _bins(slip: np.ndarray) -> list[np.ndarray]:
    """Rows of bins of equal width in the root of slip; one of too few rows joins the next."""
    order = np.argsort(slip, kind="stable")
    place = (_BINS * np.sqrt(slip[order] / max(float(slip.max()), 1e-300))).astype(int)
    groups, begin = [], 0
    for end in np.append(np.flatnonzero(np.diff(place)) + 1, slip.size).tolist():
        if end - begin >= _FEWEST:
            groups.append(order[begin:end])
            begin = end
    return groups


def _median(values: np.ndarray) -> tuple[float, float]:
    """The median and its standard error, as of at most `_TELLING` independent values."""
    middle = float(np.median(values))
    scatter = 1.4826 * float(np.median(np.abs(values - middle)))
    return middle, 1.25 * scatter / np.sqrt(min(values.size, _TELLING))


def _independent(points: _Turned) -> str:
    """Whether the medians of adhesion over bins of slip are alike within their errors."""
    medians = [_median(points.adhesion[group]) for group in _bins(points.slip)]
    if len(medians) > 1:
        low, high = min(medians), max(medians)
        if high[0] - low[0] > _APART * float(np.hypot(low[1], high[1])):
            return ""
    return (
        "These points show no dependence on slip: one number "
        f"({np.median(points.adhesion):.4g}) describes them as well as a curve does, so they tell "
        "neither a largest adhesion nor its slip."
    )


def _no_rise(points: _Turned, fit: MeasuredFit) -> str:
    groups = _bins(points.slip)
    medians = np.array([np.median(points.adhesion[group]) for group in groups])
    low, highest = float(np.median(points.slip[groups[0]])), float(medians.max())
    if medians[0] < (1 - _RISE) * highest or highest <= 0:
        return ""
    return (
        f"No rise was measured: at the smallest slips ({low:.3g}{fit.slip_unit}) adhesion is "
        f"already {percent(medians[0] / highest)} of its largest value, so that the course from "
        "slip 0 is that of the formula alone, and so is the peak."
    )


def _passed_by(points: _Turned, fit: MeasuredFit) -> str:
    top = float(np.quantile(points.adhesion, 0.95))
    # Nearer to slip 0 than its noise, or than the departure reaches, points say little of a curve.
    least = max(fit.law.span.reach, 3 * float(np.median(fit.slip_spread)))
    for group in _bins(np.where(points.slip < least, least, points.slip)):
        if points.slip[group].max() <= least:
            continue
        middle, error = _median(points.residual[group])
        if abs(middle) > _PASSED * top + 3 * error:
            low, high = points.slip[group].min(), points.slip[group].max()
            return (
                f"The fit passes by the points: between slips {low:.3g} and {high:.3g}"
                f"{fit.slip_unit} they lie {abs(middle):.2g} {'above' if middle > 0 else 'below'} "
                f"it, which is {percent(abs(middle) / top)} of the largest adhesion; they follow "
                "no one curve."
            )
    return ""


def _above(points: _Turned, answer: Answer) -> str:
    high = answer.mu_max.high
    share = float(np.mean(points.adhesion > high))
    expected = float(np.mean(norm.sf((high - points.mean) / np.maximum(points.spread, 1e-300))))
    if not share > _ABOVE + 1.5 * expected:
        return ""
    return (
        f"{percent(share)} of the points lie above the interval of the largest adhesion, which "
        f"ends at {high:.4g}; noise would put {percent(expected)} there, so the interval is not "
        "that of these points."
    )


def _wide(answer: Answer) -> str:
    level = answer.mu_max
    if level.high <= _WIDEST * level.low:
        return ""
    return (
        f"These points do not determine the largest adhesion: its 95 % interval goes from "
        f"{level.low:.3g} to {level.high:.3g}."
    )


def _shifted(points: _Turned, rows: Rows, step_s: float | None) -> list[str]:
    """Whether adhesion follows the slip of another moment clearly better than that of its own."""
    if not step_s:
        return []
    slip, adhesion = points.slip[:_MOST_ROWS], points.adhesion[:_MOST_ROWS]
    run = np.repeat(np.arange(rows.runs), np.diff(rows.starts))[: slip.size]
    reach = min(round(_LONGEST_S / step_s), int(np.median(np.diff(rows.starts))) // 8)
    if reach < 1 or slip.size < 20 * reach:
        return []
    edges = np.quantile(slip, np.linspace(0, 1, _SHIFT_BINS + 1)[1:-1])
    bins = np.searchsorted(edges, slip)
    # The same rows for every shift: those that have neighbours in their run on both sides.
    inner = np.arange(reach, slip.size - reach)
    inner = inner[run[inner - reach] == run[inner + reach]]

    def left(lag: int) -> float:
        """How far adhesion lies from its median over slips of `lag` rows before, in the median."""
        value, group = adhesion[inner], bins[inner - lag]
        middle = np.zeros(_SHIFT_BINS)
        for number in np.unique(group):
            middle[number] = np.median(value[group == number])
        return float(np.median(np.abs(value - middle[group])))

    if not inner.size:
        return []
    lags = np.unique(np.linspace(-reach, reach, min(2 * reach + 1, 81)).astype(int))
    scatter = np.array([left(int(lag)) for lag in lags])
    at_zero, best = left(0), int(scatter.argmin())
    lag = int(lags[best])
    if abs(lag) < 2 or scatter[best] >= (1 - _SHIFTED) * at_zero:
        return []
    when = "before" if lag > 0 else "after"
    return [
        "Slip and adhesion are not of one moment: adhesion follows the slip of "
        f"{abs(lag) * step_s:.2g} s {when}, about which it scatters "
        f"{percent(1 - scatter[best] / at_zero)} less; shift the late signal by --delay."
    ]


def _reached(points: _Turned, fit: MeasuredFit, answer: Answer) -> tuple[Estimate | None, str]:
    """The largest adhesion among the points, where adhesion is not seen to fall behind it."""
    # The end of a long record is that of its true slips: noise of the slip reaches further.
    last = float(np.quantile(points.slip, 0.99)) - 2 * float(np.median(fit.slip_spread))
    last = max(last, 0.5 * float(points.slip.max()))
    grid = np.linspace(float(np.quantile(points.slip, 0.01)), last, 200)
    heights = fit.law.at(grid)
    top = int(np.argmax(heights.adhesion))
    behind = slice(top + 1, None)
    falls = heights.adhesion[top] - heights.adhesion[behind]
    errors = fit.errors(heights.by_parameter[top] - heights.by_parameter[behind])[0]
    seen = bool(np.any(falls > _FALL * errors))
    inside = not np.isnan(answer.slip_opt.value) and answer.slip_opt.value <= points.slip.max()
    if seen and inside:
        return None, ""
    error = float(fit.errors(heights.by_parameter[top][None])[0][0])
    level = float(heights.adhesion[top])
    low = level * float(np.exp(-2.0 * error / max(level, 1e-300)))
    why = (
        f"Adhesion is not seen to fall up to the largest slip, {points.slip.max():.3g}"
        f"{fit.slip_unit}: the points reach {level:.4f} and do not show a peak, which may lie "
        "higher and at a larger slip."
    )
    return Estimate(level, low, np.inf), why
