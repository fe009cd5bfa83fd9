"""The points of a measured record, run by run, and their sums of products for one curve."""

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from adhesion_jax.curves import Curve
from adhesion_jax.measured.noise import MISFITS, Products
from adhesion_jax.measured.slip import SlipErrors
from adhesion_jax.measured.values import expected_values, values
from adhesion_jax.records import Record

#: Rows whose columns are held at a time.
_BLOCK = 65536

#: Parts that a single run is cut into: what is left out to judge a curve. Of many runs, several
#: make up a part.
_PARTS, _MOST_PARTS = 12, 200


class Points(NamedTuple):
    """The points of a record in the order of their runs.

    `starts` are the first points of the runs and the number of points; `part` is what a run is left
    out with. Where the order in time is not known (`ordered` is false), or where there is a single
    run (`several` is false), parts of it take the place of runs.
    """

    slip: Float[np.ndarray, " points"]  # to be expected, given the measured ones
    adhesion: Float[np.ndarray, " points"]
    conditions: Mapping[str, Float[np.ndarray, " points"]]
    unknown: Float[np.ndarray, " points"]  # variance of the slip about the expected one
    slip_noise: Float[np.ndarray, " points"]  # variance of the noise of the measured slip
    starts: Int[np.ndarray, " runs+1"]
    part: Int[np.ndarray, " runs"]
    ordered: bool
    several: bool

    @property
    def runs(self) -> int:
        return self.part.size


def arranged(
    record: Record, run: Int[np.ndarray, " points"], errors: SlipErrors, needed: Iterable[str]
) -> Points:
    """The points by run, with the `needed` conditions.

    A single run in parts: stretches in time, or every twelfth point in slip.
    """
    ordered, several = "time_s" in record.conditions, bool(run.max() > 0)
    slip, points = np.asarray(errors.slip), run.size
    if not several:
        parts = min(_PARTS, points)
        run = np.arange(points) * parts // points
        if not ordered:
            run[np.argsort(np.abs(slip), kind="stable")] = np.arange(points) % parts
    in_order = bool(np.all(run[1:] >= run[:-1]))
    order = slice(None) if in_order else np.argsort(run, kind="stable")
    starts = np.append(0, np.cumsum(np.bincount(run)))
    runs = starts.size - 1
    return Points(
        slip[order],
        np.asarray(record.adhesion)[order],
        {name: np.asarray(record.conditions[name])[order] for name in needed},
        errors.unknown[order] if errors.sigma else errors.unknown,
        errors.noise[order] if errors.sigma else errors.noise,
        starts,
        np.arange(runs) * min(runs, _MOST_PARTS) // runs,
        ordered,
        several,
    )


class Span(NamedTuple):
    """Where a curve may miss something: its height, the slip of its peak, the largest slip."""

    height: float
    middle: float
    largest: float


def misfit_functions(
    slip: Float[np.ndarray, " points"], span: Span
) -> Float[np.ndarray, "points misfits"]:
    """Functions h cos(pi j u), j from 1: odd in slip, and the same for all parameters of a curve.

    h = height s/(s + middle/4) rises as a curve does; u = s/(s + middle), relative to that of the
    largest slip, makes the functions densest about the peak.
    """
    size = np.minimum(np.abs(slip), span.largest)
    angle = np.pi * size / (size + span.middle) * (span.largest + span.middle) / span.largest
    # cos (j + 1) a = 2 cos a cos j a - cos (j - 1) a
    found = np.empty((MISFITS + 1, size.size))
    found[0], found[1] = 1.0, np.cos(angle)
    for j in range(1, MISFITS):
        found[j + 1] = 2 * found[1] * found[j] - found[j - 1]
    return (found[1:] * (span.height * slip / (np.abs(slip) + span.middle / 4))).T


def products(
    points: Points,
    curve: Curve,
    parameters: Float[np.ndarray, " free"],
    stretch: Float[np.ndarray, " free"],
    span: Span,
    weight: Float[np.ndarray, " points"],
) -> tuple[Products, float]:
    """The sums of products at these parameters, and the sum of squares of the residual.

    `stretch` are the derivatives of the parameters by the coordinates of a fit; columns are times
    `weight`. No more than a block of columns is held at a time.
    """
    count = stretch.size
    width, runs, parts = count + MISFITS + 2, points.runs, int(points.part[-1]) + 1
    sums, levels = np.zeros((4, parts, width, width)), np.zeros((4, runs, width))
    log_weight, squares = np.zeros(parts), 0.0
    block = np.zeros((_BLOCK + 1, width))  # led in by the last row of the one before
    for first in range(0, points.slip.size, _BLOCK):
        some = slice(first, first + _BLOCK)
        slip = points.slip[some]
        needed = {name: points.conditions[name][some] for name in curve.NEEDS}
        found = expected_values(curve, parameters, slip, points.unknown[some], needed)
        columns = block[1 : 1 + slip.size]
        columns[:, :count] = found.by_parameter * stretch
        columns[:, count:-2] = misfit_functions(slip, span)
        columns[:, -2] = found.adhesion
        columns[:, -1] = points.adhesion[some] - found.adhesion
        squares += float(columns[:, -1] @ columns[:, -1])
        columns *= weight[some, None]
        begin = np.searchsorted(points.starts, first, side="right") - 1
        end = np.searchsorted(points.starts, first + slip.size, side="left")
        for run in range(begin, end):
            low, high = np.clip(points.starts[run : run + 2] - first, 0, slip.size)
            told = _of_stretch(
                block[low : high + 1], bool(first + low == points.starts[run]), points.ordered
            )
            part = points.part[run]
            sums[:, part] += told
            levels[:, run] += told[:, -2]
            log_weight[part] += np.sum(np.log(weight[some][low:high]))
        block[0] = columns[-1]
    lengths = np.diff(points.starts)
    of_part = np.bincount(points.part, lengths, parts)
    linked = np.bincount(points.part, lengths - 1, parts) if points.ordered else 0 * of_part
    return Products(sums, levels, points.part, of_part, linked, log_weight), squares


def weights(
    points: Points, curve: Curve, parameters: Float[np.ndarray, " free"], sigma: float
) -> Float[np.ndarray, " points"]:
    """Standard deviations of the noise, sigma, as a share of those with the error of the slip."""
    found = np.empty(points.slip.size)
    for first in range(0, found.size, _BLOCK):
        some = slice(first, first + _BLOCK)
        needed = {name: points.conditions[name][some] for name in curve.NEEDS}
        slope = values(curve, parameters, points.slip[some], needed).by_slip
        found[some] = 1 / np.sqrt(1 + slope**2 * points.slip_noise[some] / sigma**2)
    return found


def _of_stretch(led: np.ndarray, begins: bool, ordered: bool) -> np.ndarray:
    """The four sums over a stretch of one run, whose first row is that of the point before it."""
    found = np.zeros((4, led.shape[1], led.shape[1]))
    rows = led[1:]
    if not ordered:
        found[0] = rows.T @ rows
        return found
    now, before = (rows[1:], rows[:-1]) if begins else (rows, led[:-1])
    if begins:
        found[0] = np.outer(rows[0], rows[0])
    crossed = now.T @ before
    found[1], found[2], found[3] = now.T @ now, crossed + crossed.T, before.T @ before
    return found
