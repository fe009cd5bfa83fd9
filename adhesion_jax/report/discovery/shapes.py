"""The law over slip at several values of a column that bends the shape of the curve."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from adhesion_jax.curves import adhesion_of
from adhesion_jax.discovery.types import Findings
from adhesion_jax.report.discovery.tables import shape_columns
from adhesion_jax.report.discovery.words import column_label, humanised, number
from adhesion_jax.report.style import AFTER, STRETCHED, label_text, panels, slip_axis

#: Shares of the points below the values that are drawn, and their lines.
_QUANTILES: Mapping[float, Mapping[str, Any]] = {
    0.05: {"color": "#56B4E9", "linestyle": (0, (5, 2))},
    0.5: {"color": AFTER, "linestyle": "-"},
    0.95: {"color": "#D55E00", "linestyle": (0, (5, 1, 1, 1))},
}

#: The slip counts as one value if it varies by less than this share of its size.
_ONE_SLIP = 1e-6

#: A side of zero is reached if its largest slip exceeds this share of that of the other side.
_REACHED = 0.05


def shape_panels(findings: Findings) -> Figure | None:
    """A panel for each effect and column, other columns at their medians; None without effects."""
    shown = shape_columns(findings)
    if not shown:
        return None
    low, high = slip_limits(findings)
    grid = law_grid(findings)
    conditions = medians(findings)
    figure, axes = panels(len(shown), 2.6, "adhesion (1)")
    for axis, (effect, name) in zip(axes, shown, strict=True):
        for quantile, style in _QUANTILES.items():
            value = float(findings.points[name].quantile(quantile))
            adhesion = adhesion_of(findings.law, grid, {**conditions, name: value})
            axis.plot(grid, adhesion, label=f"{number(value)} ({100 * quantile:.0f} %)", **style)
        slip_axis(axis, low, high, gap=0.13)
        axis.set_xlim(low, high)
        axis.set_xlabel(f"{column_label(findings.slip)}, {STRETCHED}")
        axis.set_title(label_text(humanised(effect.name)), fontsize=9, loc="left")
        legend = axis.legend(fontsize=8, frameon=False, title=label_text(column_label(name), 34))
        legend.get_title().set_fontsize(8)
    return figure


def slip_limits(findings: Findings) -> tuple[float, float]:
    """The ends of the slip axis: zero and a little more than the measured slips."""
    slip = findings.points["slip"].to_numpy(dtype=float)
    low, high = min(0.0, 1.04 * slip.min()), max(0.0, 1.04 * slip.max())
    return (low, high) if low < high else (low, 1.0)  # every slip may be zero


def law_grid(findings: Findings) -> np.ndarray:
    """The slips at which laws are drawn, in equal steps of their roots, [301].

    On both sides of zero only where both are reached: noise of the slip makes some of either sign.
    Where all slips are one, that one, [1]: of the curve about it nothing was measured.
    """
    slip = findings.points["slip"].to_numpy(dtype=float)
    if np.ptp(slip) <= _ONE_SLIP * np.abs(slip).max():
        return slip[:1]
    low, high = slip_limits(findings)
    low, high = (low if -low > _REACHED * high else 0.0), (high if high > -_REACHED * low else 0.0)
    root = np.linspace(-np.sqrt(-low), np.sqrt(high), 301)
    return np.sign(root) * root**2


def medians(findings: Findings) -> Mapping[str, float]:
    """The median of every column, so that the law is drawn in its steady state."""
    numeric = findings.points.select_dtypes("number").drop(
        columns=["run", "slip", "adhesion", "before", "after"], errors="ignore"
    )
    calendar = findings.law.calendar
    middle = {calendar.column: float(calendar.start + calendar.end) / 2}
    return {**middle, **{str(name): float(value) for name, value in numeric.median().items()}}
