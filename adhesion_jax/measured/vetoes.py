"""What forbids an answer: each is one sentence that a glance at the figure would make."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.stats import chi2, f, norm

from adhesion_jax.data.plausible import at_half, bins_of, exchanged, no_contact_has, roughness
from adhesion_jax.inference.fit import MeasuredFit
from adhesion_jax.inference.rows import Rows, in_stretches
from adhesion_jax.measured.answer import NOT_KNOWN, Answer, Estimate
from adhesion_jax.measured.comparison import WIDEST, Comparison
from adhesion_jax.wording import percent

#: Longest shift that is tried, s, and as a share of the usual run; the share of the roughness, with
#: that beyond chance, and of what noise does not account for, that another moment must take.
_LONGEST_S, _OF_RUN, _SHIFTED, _EXPLAINED = 2.0, 0.25, 0.2, 0.6

#: Most rows by which a shift is judged, and the fewest.
_ROWS_SHIFTED, _FEWEST_ROWS = 200_000, 24

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
    slip, adhesion = points.slip[:_ROWS_SHIFTED], points.adhesion[:_ROWS_SHIFTED]
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
    # The roughness that noise alone makes: by second differences in time, as if it were white.
    low, high = np.quantile(adhesion[inner], [0.01, 0.99])
    bends = np.abs(adhesion[inner - 1] - 2 * adhesion[inner] + adhesion[inner + 1])
    floor = float(np.mean(bends)) / np.sqrt(3) / max(float(high - low), 1e-300)
    if abs(lag) < 2 or at_zero - left[best] < max(clear, _EXPLAINED * (at_zero - floor)):
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


#: Most points of a bin that count as independent; medians differ whose scatter chance makes more
#: rarely.
_TELLING, _BY_CHANCE = 12, 1e-4

#: The scatter that so many normal points show is half of the true one in one case of 10,000, and
#: that of n points about 1 + 60/n times smaller.
_HALVED = 60

#: Of fewer points bins say little: medians of two, one on either side of a peak, may be alike.
_FEW_POINTS = 25

#: Least share of the largest adhesion by which the curve rises among the points.
_RISE = 0.1

#: A fall behind the peak is seen if it exceeds this multiple of its standard error.
_FALL = 2.0

#: A median residual beyond this share of the largest adhesion and three standard errors is passed
#: by; a smaller share of the points than this are outliers, which a robust fit leaves. Share of the
#: points that may lie above the interval beyond what noise makes.
_PASSED, _FEW, _ABOVE = 0.1, 0.02, 0.1

#: Slips beyond this multiple of their noise are looked at, up to those whose median reaches this
#: share of the largest adhesion; the line misses 0 by this multiple of its error, and this share.
_FAR, _RISEN, _OFF = 4.0, 0.6, 0.05

#: About as many rows, in stretches, are judged.
_MOST_ROWS = 1_000_000

#: Passages of a slip in one rise and return.
_ONE_EVENT = 2

#: What an answer assumes if slip passes its values once in time.
_ONE_SWEEP = (
    "Slip passes its values only once: a slow change of the rail within this one sweep and the "
    "shape of the curve cannot be told apart, and the answer holds if the rail did not change; "
    "measure further sweeps, or the way back."
)


class Judgement(NamedTuple):
    """What may be said of the peak; with a veto no number stands for the largest adhesion."""

    vetoes: tuple[str, ...]
    at_least: Estimate | None  # the largest adhesion among the points, where no peak is seen
    why: str  # no peak is seen; empty where one is
    warning: str  # what the answer assumes that the points cannot show; empty with a veto


def judged(
    fits: Mapping[str, MeasuredFit],
    answer: Answer,
    rows: Rows,
    step_s: float | None,
    branches: Comparison | None,
) -> Judgement:
    """The vetoes, by the curve that has most weight; `step_s` is the usual time between rows."""
    fit = fits[max(answer.weights, key=lambda name: answer.weights[name])]
    rows, chosen = in_stretches(rows, _MOST_ROWS)
    mean, slope = fit.at_rows(rows, chosen)
    left = rows.adhesion - mean
    side = np.where(rows.slip < 0, -1.0, 1.0)
    noise = fit.noise.spread(rows.design, mean, slope * fit.slip_scatter[chosen])
    points = Points(np.abs(rows.slip), side * rows.adhesion, side * left, side * mean, noise)
    sweeps, late = passages(points, rows), shifted(points, rows, step_s)
    # Of one rise and return of slip, a slow change of the rail makes the same loop as a shift.
    clearly_late = late if sweeps > _ONE_EVENT else ""
    found = [_no_adhesion(points), clearly_late or exchanged(points.slip, points.adhesion)]
    if not any(found):
        followed = _followed(points, fit)
        alike = "" if followed else independent_of_slip(points)
        other = alike or _no_rise(points, fit, followed) or _passed_by(points, fit)
        found.append(late if other and late else other)
    if np.all(fit.held):
        found.append("Every parameter of the curve is held at a bound or has no influence.")
    if branches is not None and (branches.changed or branches.bent):
        found.append(_two_branches(branches))
    at_least, why = _reached(points, fit, answer) if not any(found) else (None, "")
    moved = float(np.median(fit.slip_spread))
    elsewhere = "" if any(found) else zero_elsewhere(points, rows.slip, moved, fit.slip_unit)
    if not any(found) and at_least is None:
        wide = _wide(answer)
        found += [_above(points, answer), wide and elsewhere, wide]
    vetoes = tuple(dict.fromkeys(filter(None, found)))
    single = _ONE_SWEEP if rows.ordered and sweeps <= 1 else ""
    warning = " ".join(filter(None, (elsewhere, single)))
    return Judgement(vetoes, at_least, why, "" if vetoes else warning)


def standing(answer: Answer, judgement: Judgement) -> tuple[Estimate, Estimate]:
    """The largest adhesion and its slip that may be told: neither with a veto."""
    if judgement.vetoes:
        return NOT_KNOWN, NOT_KNOWN
    if judgement.at_least is not None:
        return judgement.at_least, NOT_KNOWN
    return answer.mu_max, answer.slip_opt


def _no_adhesion(points: Points) -> str:
    said = no_contact_has(points.adhesion)
    if not said:
        return ""
    return (
        f"No contact has this adhesion: {said}. The unit of the force or of the load is probably "
        'another one; say it, as in --column "axle_force=F [kN]".'
    )


def _two_branches(branches: Comparison) -> str:
    table = branches.table.set_index("branch")["mu_max"]
    how = "level" if branches.changed else "course over slip"
    return (
        f"Traction and braking are no one curve: their {how} differs (p = "
        f"{min(branches.p, branches.p_shape):.1g}; under one curve the largest adhesion would be "
        f"{table['traction']:.4f} in traction and {table['braking']:.4f} in braking); identify "
        "each by itself."
    )


def _median(values: np.ndarray) -> tuple[float, float]:
    """The median and its standard error, as of at most `_TELLING` independent values."""
    middle = float(np.median(values))
    scatter = 1.4826 * float(np.median(np.abs(values - middle)))
    return middle, 1.25 * scatter / np.sqrt(min(values.size, _TELLING))


def _followed(points: Points, fit: MeasuredFit) -> bool:
    """Whether points too few for bins are surely nearer to the curve than to a level (F test)."""
    size, parameters = points.slip.size, fit.held.size + fit.departure.degrees
    if not parameters < size < _FEW_POINTS:
        return False
    left = max(float(points.residual @ points.residual), 1e-300) / (size - parameters)
    taken = (size * float(points.adhesion.var()) - left * (size - parameters)) / (parameters - 1)
    return bool(f.sf(taken / left, parameters - 1, size - parameters) < _BY_CHANCE)


def independent_of_slip(points: Points) -> str:
    """Whether the medians of adhesion over bins of slip are alike within their errors (chi^2).

    The error is that of the scatter about a line through the points of a bin, for a rise within it
    is no noise. By chance the scatter of few points is small: it counts as the usual one, or as
    the largest that theirs may be.
    """
    medians, errors, sizes = [], [], []
    for group in bins_of(points.slip):
        slip = points.slip[group] - points.slip[group].mean()
        adhesion = points.adhesion[group]
        about = adhesion - slip * (slip @ adhesion) / max(slip @ slip, 1e-300)
        medians.append(float(np.median(adhesion)))
        sizes.append(group.size)
        errors.append(_median(about)[1] * np.sqrt(group.size / (group.size - 2)))
    if len(medians) > 1:
        own = np.maximum(errors, 1e-12)
        most = own * (1 + _HALVED / np.array(sizes))
        weights = np.maximum(own, np.minimum(most, np.median(own))) ** -2.0
        apart = np.array(medians) - np.average(medians, weights=weights)
        if chi2.sf(weights @ apart**2, len(medians) - 1) < _BY_CHANCE:
            return ""
    return (
        "These points show no dependence on slip: one number "
        f"({np.median(points.adhesion):.4g}) describes them as well as a curve does, so they tell "
        "neither a largest adhesion nor its slip."
    )


def _no_rise(points: Points, fit: MeasuredFit, followed: bool) -> str:
    groups, values = bins_of(points.slip), points.adhesion
    if followed:  # then the curve is measured at every point
        groups, values = [*np.argsort(points.slip)[:, None]], points.mean
    medians = np.array([np.median(values[group]) for group in groups])
    low, highest = float(np.median(points.slip[groups[0]])), float(medians.max())
    if medians[0] < (1 - _RISE) * highest or highest <= 0:
        return ""
    return (
        f"No rise was measured: at the smallest slips ({low:.3g}{fit.slip_unit}) adhesion is "
        f"already {percent(medians[0] / highest)} of its largest value, so that the course from "
        "slip 0 is that of the formula alone, and so is the peak."
    )


def _passed_by(points: Points, fit: MeasuredFit) -> str:
    top = float(np.quantile(points.adhesion, 0.95))
    # Nearer to slip 0 than its noise, or than the departure reaches, points say little of a curve.
    least = max(fit.law.span.reach, 3 * float(np.median(fit.slip_spread)))
    for group in bins_of(np.where(points.slip < least, least, points.slip)):
        if points.slip[group].max() <= least or group.size < _FEW * points.slip.size:
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


def _above(points: Points, answer: Answer) -> str:
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


def zero_elsewhere(
    points: Points, slip: Float[np.ndarray, " rows"], noise: float, unit: str
) -> str:
    """Whether a straight line through the points of small slip meets adhesion 0 beyond slip 0.

    Through points of a curve that rises from 0 ever less steeply it meets slip 0 at an adhesion of
    0 or more. `slip` has its sign: the points are those of the branch that has most of them; and
    `noise` is its standard deviation.
    """
    most = (slip < 0) == (np.mean(slip < 0) > 0.5)
    # Nearer to slip 0 than its noise, chance has moved the points that are measured there.
    some = most & (points.slip > _FAR * noise)
    size, adhesion = points.slip[some], points.adhesion[some]
    groups = bins_of(size) if some.any() else []
    medians = np.array([np.median(adhesion[group]) for group in groups])
    high = np.flatnonzero(medians >= _RISEN * medians.max(initial=0.0))
    if not high.size or not high[0]:
        return ""
    low = np.concatenate(groups[: high[0]])
    if low.size < _TELLING:
        return ""
    terms = np.column_stack([np.ones(low.size), size[low]])
    inverse = np.linalg.pinv(terms.T @ terms)
    level, slope = inverse @ terms.T @ adhesion[low]
    left = adhesion[low] - terms @ (level, slope)
    # As of few independent points, for neighbours in time are alike.
    error = np.sqrt(inverse[0, 0] * np.mean(left**2) * low.size / _TELLING)
    if slope <= 0 or level > -max(_FAR * error, _OFF * medians.max()):
        return ""
    zero = -level / slope
    radius = "" if unit else f"a wheel radius that is wrong by {percent(zero)}, or "
    return (
        f"By a straight line through the points below slip {size[low].max():.3g}{unit} "
        f"adhesion is 0 at slip {zero:.3g}{unit} and not at slip 0: {radius}a force whose "
        f"zero is off by {-level:.2g} of the load, does that; correct it first, for the slip of "
        "the peak or its height is off by as much."
    )


def _wide(answer: Answer) -> str:
    level = answer.mu_max
    if level.high <= WIDEST * level.low:
        return ""
    return (
        f"These points do not determine the largest adhesion: its 95 % interval goes from "
        f"{level.low:.3g} to {level.high:.3g}."
    )


def _reached(points: Points, fit: MeasuredFit, answer: Answer) -> tuple[Estimate | None, str]:
    """The largest adhesion among the points, where adhesion is not seen to fall behind it.

    Nothing is told of it where its error is so large that it may be half of that.
    """
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
    if level > WIDEST * low:
        return None, ""
    why = (
        f"Adhesion is not seen to fall up to the largest slip, {points.slip.max():.3g}"
        f"{fit.slip_unit}: the points reach {level:.4f} and do not show a peak, which may lie "
        "higher and at a larger slip."
    )
    return Estimate(level, low, np.inf), why
