"""What is asked of a fit: a curve, where its departure lives, and where its search begins."""

from collections.abc import Mapping

import numpy as np

from adhesion_jax.curves import SLIP_LIMIT, Curve
from adhesion_jax.curves.base import SLIP_VELOCITY_LIMIT
from adhesion_jax.curves.bent import FUNCTIONS
from adhesion_jax.inference.descent import Problem
from adhesion_jax.inference.grouping import evenly
from adhesion_jax.inference.law import FittedLaw, peak_of
from adhesion_jax.inference.rows import Rows
from adhesion_jax.inference.shares import parameters_at
from adhesion_jax.inference.values import Span

#: Share of the largest slip about which a departure is finest, for a curve without a peak; and the
#: share of the slip of the peak below which its functions are straight.
_MIDDLE, _REACH = 0.2, 0.2


def posed(
    curve: Curve, start: np.ndarray, rows: Rows, slip_is_velocity: bool
) -> tuple[Problem, Mapping[str, float], float]:
    """The problem, the conditions of its peak, and the largest slip of that."""
    limit = SLIP_VELOCITY_LIMIT if slip_is_velocity else SLIP_LIMIT
    conditions = {name: float(np.median(rows.conditions[name])) for name in curve.NEEDS}
    largest = float(max(rows.slip.max(), -rows.slip.min(), np.finfo(float).tiny))
    return Problem(curve, _span(curve, start, conditions, limit, largest)), conditions, limit


def from_start(start: np.ndarray) -> np.ndarray:
    return np.append(np.clip(start, 0.0, 1.0), np.zeros(FUNCTIONS))


def chosen_of(column: np.ndarray, count: int) -> np.ndarray:
    return column[evenly(column.size, count)]


def _span(
    curve: Curve, start: np.ndarray, conditions: Mapping[str, float], limit: float, largest: float
) -> Span:
    """Finest about the peak of the curve of least squares, if that lies among the points."""
    usual = Span(_REACH * _MIDDLE * largest, largest)
    parameters = np.append(parameters_at(curve, start), np.zeros(FUNCTIONS))
    peak = peak_of(FittedLaw(curve, parameters, usual, conditions), limit)
    middle = peak.slip if peak.found and 0 < peak.slip < largest else _MIDDLE * largest
    return Span(_REACH * middle, largest)
