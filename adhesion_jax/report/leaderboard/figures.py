"""Figures of a board: what is dominated, on which rails, how soon it holds, and where it runs."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from adhesion_jax.campaign.traction import WHOLE
from adhesion_jax.leaderboard.judging import COURSES, Shown
from adhesion_jax.leaderboard.runs import SLIPS, Course
from adhesion_jax.leaderboard.table import COSTS, RANKED_BY
from adhesion_jax.leaderboard.terms import OPTIMA
from adhesion_jax.report.style import light_frame, line_styles, one_legend


@dataclass(frozen=True, eq=False, repr=False)
class Judged:
    """What figures are drawn of."""

    table: pd.DataFrame
    segments: pd.DataFrame  # figures of each run and segment
    courses: Mapping[tuple[str, str], Shown]  # by rails and method

    @property
    def first(self) -> pd.DataFrame:
        """The rows of the rails that methods were tuned on."""
        return self.table[self.table["rails"] == self.table["rails"].iloc[0]]


#: What is not ranked is drawn in this grey.
_QUIET = "0.6"

_AXES = {
    "torque_variation": "torque variation (kN m/s)",
    "slip_energy_share": "slip energy per useful work",
}


def trade(board: Judged) -> Figure:
    """Utility at price 1 against what it costs: a line joins what no other beats in both."""
    rows = board.first
    figure = Figure(figsize=(11.5, 5.4), layout="constrained")
    styles = line_styles([*rows["method"]])
    for axis, cost in zip(figure.subplots(1, 2, sharey=True), COSTS, strict=True):
        for _, row in rows.iterrows():
            style, fair = styles[row["method"]], row["remark"] == ""
            axis.errorbar(
                row[cost],
                row[f"{RANKED_BY}_share"],
                yerr=2 * row[f"{RANKED_BY}_share_se"],
                color=style["color"] if fair else _QUIET,
                marker=style["marker"],
                markerfacecolor=style["color"] if fair else "white",
                linestyle="none",
                label=row["method"],
            )
        front = _front(rows[rows["remark"] == ""], cost)
        axis.plot(front[cost], front[f"{RANKED_BY}_share"], color="0.4", lw=0.9, zorder=0)
        axis.set(xlabel=_AXES[cost], xscale="log")
        axis.xaxis.set_major_locator(LogLocator(subs=(1, 2, 3, 5, 7)))
        axis.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
        axis.xaxis.set_minor_locator(NullLocator())
        light_frame(axis)
        axis.label_outer()
    figure.axes[0].set_ylabel("utility at price 1, share of its true optimum")
    one_legend(figure, figure.axes, loc="outside lower center", ncols=4)
    return figure


def _front(rows: pd.DataFrame, cost: str) -> pd.DataFrame:
    """Those with a larger utility than all that cost less, from the cheapest on."""
    ordered = rows.sort_values(cost)
    largest = ordered[RANKED_BY].cummax().shift(fill_value=-np.inf)
    return ordered[ordered[RANKED_BY] > largest]


def rail_map(board: Judged) -> Figure:
    """Utilisation of each method on each family, the darker the less."""
    values = board.table.pivot_table(
        index="method", columns="rails", values="utilisation", sort=False, dropna=False
    )
    # The longer list stands below one another, where names need no turning and a page has room.
    used = values if len(values) >= len(values.columns) else values.T
    size = (3.2 + 0.6 * len(used.columns), 1.8 + 0.34 * len(used))
    figure = Figure(figsize=size, layout="constrained")
    axis = figure.subplots()
    axis.imshow(used.to_numpy(dtype=float), cmap="gray", vmin=0.3, vmax=1.0, aspect="auto")
    for (row, column), value in np.ndenumerate(used.to_numpy(dtype=float)):
        if np.isfinite(value):
            ink = "white" if value < 0.7 else "black"
            told = f"{value:.3f}".replace("0.", ".", 1)
            axis.text(column, row, told, ha="center", va="center", color=ink, fontsize=9.5)
    axis.set_xticks(range(len(used.columns)), used.columns, rotation=50, ha="right")
    axis.set_yticks(range(len(used)), used.index)
    axis.set_title("utilisation", fontsize=10)
    return figure


def readhesion(board: Judged) -> Figure:
    """The share of the segments that hold again within a time, of each method."""
    rows = board.first
    segments = board.segments
    parts = segments[(segments["segment"] != WHOLE) & (segments["rails"] == rows["rails"].iloc[0])]
    parts = parts[np.isfinite(parts["never95"])]
    figure = Figure(figsize=(9.0, 5.4), layout="constrained")
    axis = figure.subplots()
    methods = [name for name in rows["method"] if name not in [*OPTIMA.values()][1:]]
    for name, style in line_styles(methods).items():
        times = np.sort(parts.loc[parts["method"] == name, "t95"].fillna(np.inf).to_numpy())
        there = np.isfinite(times)
        if there.any():
            shares = np.arange(1, len(times) + 1) / len(times)
            look: dict[str, Any] = {key: style[key] for key in ("color", "linestyle")}
            axis.step(
                np.maximum(times[there], 1e-3), shares[there], where="post", label=name, **look
            )
    axis.set(xscale="log", ylim=(0, 1.01), xlabel="time until 95 % of the largest adhesion (s)")
    axis.set_ylabel("share of the segments")
    light_frame(axis)
    one_legend(figure, [axis], loc="outside lower center", ncols=4)
    return figure


def points(board: Judged) -> Figure:
    """The operating points of the best, the median and the worst run of the first method."""
    rows = board.first
    name = next(one for one in rows["method"] if (rows["rails"].iloc[0], one) in board.courses)
    used, course = board.courses[rows["rails"].iloc[0], name]
    figure = Figure(figsize=(11.5, 4.4), layout="constrained")
    axes = figure.subplots(1, len(COURSES), sharey=True)
    for place, axis in enumerate(axes):
        segments = np.unique(course.segment[place])
        styles = line_styles([*map(str, range(len(course.curve[place])))])
        for number in segments:
            _segment(axis, course, place, int(number), styles[str(number)])
        axis.set(title=f"{COURSES[place]} run: {used[place]:.4f}", xlabel="slip (m/s)")
        axis.set_xlim(0, 0.6)
        light_frame(axis)
    axes[0].set_ylabel("adhesion")
    figure.suptitle(f"{name} on {rows['rails'].iloc[0]} rails: share of the largest adhesion used")
    one_legend(figure, axes, loc="outside lower center", ncols=4)
    return figure


def _segment(axis: Axes, course: Course, run: int, number: int, style: Mapping[str, Any]) -> None:
    """Slip and adhesion of the first axle in a segment, over the curve and the peak at its end."""
    rows = course.segment[run] == number
    slip, adhesion = (getattr(course, name)[run][rows, 0] for name in ("slip", "adhesion"))
    colour = style["color"]
    axis.plot(SLIPS, course.curve[run, number], color=colour, ls=style["linestyle"], lw=1.1)
    axis.plot(slip, adhesion, ".", color=colour, ms=3, label=f"segment {number + 1}")
    peak = course.peak_slip[run][rows, 0][-1], course.peak_adhesion[run][rows, 0][-1]
    axis.plot(*peak, style["marker"], color=colour, mfc="white", ms=7)


#: What draws each figure, by its name.
FIGURES_OF: Mapping[str, Callable[[Judged], Figure]] = {
    "trade": trade,
    "rails": rail_map,
    "readhesion": readhesion,
    "points": points,
}
