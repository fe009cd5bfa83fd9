"""The figure of a followed log: estimates with bands and resets over what was measured."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec

from adhesion_jax.identifiers.base import Status
from adhesion_jax.measured.following import QUANTILE, Followed, as_told
from adhesion_jax.measured.log import Log
from adhesion_jax.report.style import POINT, Shown, label_text, light_frame, line_styles, one_legend

#: Most slip events that have a panel of their own: those of the largest slip.
MOST_EVENTS = 6

#: Equal parts of the axis of which the smallest and the largest sample are drawn.
_PARTS = 1200

#: The axis of adhesion ends at this multiple of all but the largest thousandth of what was
#: measured.
_HEAD = 1.25

#: Inches: of the figure, of its rows, and of those of an event.
_WIDTH, _ESTIMATES, _STATUS, _SIGNAL = 11.5, 3.4, 0.2, 1.0
_EVENT, _EVENT_SLIP, _GAP = 1.9, 0.65, 0.42

#: Colours of the samples of an event that the methods are given, and of those that they are not.
_USED, _PASSED_OVER = "0.45", "0.78"

#: Line of the adhesion reached where no fall shows that it is the largest.
_AT_LEAST: Mapping[str, Any] = {"linewidth": 0.7, "marker": "^", "markersize": 3.5, "alpha": 0.7}


class _Drawn(NamedTuple):
    """What is drawn of a log, and how."""

    log: Log
    followed: Mapping[str, Followed]
    styles: Mapping[str, Mapping[str, Any]]  # colour, dash and marker of each method
    top: float  # of the axis of adhesion


class _Axis(NamedTuple):
    """What the samples are drawn over."""

    place: Float[np.ndarray, " samples"]
    label: str
    begin: float = 0.0  # s, of the log
    scale: float = 1.0  # seconds per unit


def track_figure(title: str, log: Log, followed: Mapping[str, Followed]) -> Figure:
    """Estimates over measured adhesion, the status of each method, slip and speed; then events."""
    top = _HEAD * float(np.quantile(np.abs(log.adhesion), 0.999))
    drawn = _Drawn(log, followed, line_styles(list(followed)), top)
    signals, chosen = _signals(log), _largest(log)
    heights = [_ESTIMATES, _STATUS * (len(followed) + 1), *[_SIGNAL] * len(signals)]
    rows, overview = -(-len(chosen) // 3), sum(heights) + _GAP * 1.6
    height = overview + rows * (_EVENT + _EVENT_SLIP + 1.5 * _GAP) + (1.6 if rows else 1.3)
    figure = Shown(figsize=(_WIDTH, height))
    sides, top_gap = {"left": 0.1, "right": 0.985}, 0.4
    above = figure.add_gridspec(
        len(heights),
        1,
        height_ratios=heights,
        top=1 - top_gap / height,
        bottom=1 - (top_gap + overview) / height,
        hspace=0.12,
        **sides,
    )
    estimates = _overview(figure, above, drawn, signals, chosen)
    estimates.set_title(
        f"{label_text(title)}: largest adhesion as known after each sample, with 95 % bands",
        loc="left",
        fontsize=11,
    )
    if chosen.size:
        below = figure.add_gridspec(
            rows,
            min(3, len(chosen)),
            top=1 - (top_gap + overview + 2 * _GAP) / height,
            bottom=1.25 / height,
            hspace=1.2 * _GAP / _EVENT,
            wspace=0.16,
            **sides,
        )
        _events(figure, below, drawn, chosen)
    one_legend(figure, figure.axes, ncols=5)
    return figure


def _overview(
    figure: Figure,
    grid: GridSpec,
    drawn: _Drawn,
    signals: Sequence[tuple[np.ndarray, str]],
    chosen: Int[np.ndarray, " chosen"],
) -> Axes:
    """The whole log, a panel below the other, with the chosen events shaded; the first panel."""
    log, axis = drawn.log, _axis(drawn.log)
    estimates = figure.add_subplot(grid[0])
    _measured(estimates, axis, np.abs(log.adhesion))
    _estimates(estimates, axis, drawn)
    estimates.set(ylabel="size of adhesion (1)", ylim=(0.0, drawn.top))
    status = figure.add_subplot(grid[1], sharex=estimates)
    _status(status, axis, drawn)
    panels = [estimates, status]
    for place, (values, label) in enumerate(signals, 2):
        panel = figure.add_subplot(grid[place], sharex=estimates)
        _measured(panel, axis, values)
        panel.set_ylabel(label)
        panels.append(panel)
    estimates.set_xlim(axis.place[0], axis.place[-1] + 1e-9)
    for event in chosen:
        begin, end = (log.events[event] - axis.begin) / axis.scale
        for panel in (*panels[:1], *panels[2:]):
            panel.axvspan(begin, end, color="0.88", zorder=0, linewidth=0)
        panels[-1].annotate(
            str(event + 1),
            ((begin + end) / 2, 1.0),
            xycoords=("data", "axes fraction"),
            ha="center",
            va="top",
            fontsize=8,
        )
    for panel in panels:
        light_frame(panel)
        panel.tick_params(labelbottom=panel is panels[-1])
    panels[-1].set_xlabel(axis.label)
    figure.align_ylabels([estimates, *panels[2:]])
    return estimates


def _events(
    figure: Figure, grid: GridSpec, drawn: _Drawn, chosen: Int[np.ndarray, " chosen"]
) -> None:
    """The chosen events, three in a row."""
    for number, event in enumerate(chosen.tolist()):
        both = grid[divmod(number, 3)].subgridspec(
            2, 1, height_ratios=(_EVENT, _EVENT_SLIP), hspace=0.1
        )
        upper = figure.add_subplot(both[0])
        lower = figure.add_subplot(both[1], sharex=upper)
        _event(upper, lower, drawn, event)
        upper.set_title(f"slip event {event + 1}", loc="left", fontsize=9)
        if number % 3 == 0:
            upper.set_ylabel("adhesion (1)")
            lower.set_ylabel(f"slip ({drawn.log.slip_unit.strip() or '1'})")


def _axis(log: Log) -> _Axis:
    if log.time is None:
        return _Axis(np.arange(1.0, log.slip.size + 1), "sample")
    span = log.time[-1] - log.time[0]
    unit, scale = next(
        (unit, scale)
        for unit, scale, least in (("h", 3600.0, 7200.0), ("min", 60.0, 600.0), ("s", 1.0, -1.0))
        if span > least
    )
    begin = float(log.time[0])
    label = f"time from the beginning of the log ({unit})"
    return _Axis((log.time - begin) / scale, label, begin, scale)


def _largest(log: Log) -> Int[np.ndarray, " chosen"]:
    """The events of the largest slip, in the order of time."""
    if log.time is None:
        return np.zeros(0, dtype=int)
    size = [
        np.abs(log.slip[slice(*np.searchsorted(log.time, event))]).max() for event in log.events
    ]
    return np.sort(np.argsort(size)[::-1][:MOST_EVENTS])


def _signals(log: Log) -> Sequence[tuple[np.ndarray, str]]:
    slip = (log.slip, f"slip ({log.slip_unit.strip() or '1'})")
    if log.speed is None or np.ptp(log.speed) == 0:
        return [slip]
    return [slip, (3.6 * log.speed, "speed (km/h)")]


def _measured(panel: Axes, axis: _Axis, values: np.ndarray) -> None:
    """The samples or, of many, the smallest and the largest in equal parts of the axis."""
    if values.size <= 2 * _PARTS:
        panel.plot(axis.place, values, ".", color=POINT, markersize=2.5, zorder=1, label="measured")
        return
    edges = np.linspace(axis.place[0], axis.place[-1], _PARTS + 1)
    begin = np.searchsorted(axis.place, edges[:-1])
    there = np.diff(np.append(begin, values.size)) > 0
    low, high = (
        np.where(there, of.reduceat(values, begin), np.nan) for of in (np.minimum, np.maximum)
    )
    # A part of one value has no height: the line around it keeps it visible.
    panel.fill_between(
        edges[:-1],
        low,
        high,
        step="post",
        facecolor="0.75",
        edgecolor="0.6",
        linewidth=0.7,
        label="measured, smallest to largest",
    )


def _estimates(panel: Axes, axis: _Axis, drawn: _Drawn) -> None:
    """Every method as a step line with its band; thin, without a band, where it is not trusted.

    Where adhesion does not fall, the adhesion reached is a thin line with triangles that point up.
    """
    for name, one in drawn.followed.items():
        style = drawn.styles[name]
        place, value, error, bare, trusted = _steps(
            axis, as_told(one.estimates), "mu_max", "mu_max_se", "at_least"
        )
        reached = np.where(bare, value, np.nan)
        if np.isfinite(reached).any():  # else there is no place for a marker
            panel.plot(place, reached, color=style["color"], markevery=0.03, **_AT_LEAST)
        trusted, untrusted = trusted & (bare == 0), ~trusted & (bare == 0)
        half = np.where(np.isfinite(error) & trusted, QUANTILE * error, np.nan)
        panel.fill_between(
            place, value - half, value + half, color=style["color"], alpha=0.2, linewidth=0
        )
        panel.plot(
            place,
            np.where(trusted, value, np.nan),
            color=style["color"],
            linestyle=style["linestyle"],
            linewidth=1.7,
            zorder=5,
            label=label_text(name),
        )
        # Lines to and from what lies outside the axis would cover what lies inside.
        seen = untrusted & (value > 0) & (value < drawn.top)
        panel.plot(
            place, np.where(seen, value, np.nan), color=style["color"], linestyle=":", linewidth=0.7
        )
    # Empty lines, which stand in the legend for those of all methods.
    if any(one.estimates["at_least"].any() for one in drawn.followed.values()):
        label = "at least: adhesion does not fall"
        panel.plot([], [], color="black", label=label, **_AT_LEAST)
    panel.plot([], [], color="black", linestyle=":", linewidth=0.9, label="not trusted")


def _steps(axis: _Axis, table: pd.DataFrame, *names: str) -> tuple[np.ndarray, ...]:
    """Both ends of the time for which each row holds, the columns, and whether it is trusted.

    The last row holds to the end of the axis.
    """
    place = np.append(axis.place[table["sample"]], axis.place[-1])
    trusted = np.asarray(table["status"] == Status.TRUSTED.value)
    columns = (*(table[name].to_numpy(float) for name in names), trusted)
    return (np.repeat(place, 2)[1:-1], *(np.repeat(column, 2) for column in columns))


def _status(panel: Axes, axis: _Axis, drawn: _Drawn) -> None:
    """A strip a method: full where it is trusted, hatched where not, a mark at each reset."""
    followed = drawn.followed
    for row, (name, one) in enumerate(followed.items()):
        place, trusted = _steps(axis, one.estimates)
        for chosen, look in (
            (trusted, {"facecolor": drawn.styles[name]["color"], "alpha": 0.55}),
            (
                ~trusted,
                {
                    "facecolor": "none",
                    "hatch": "//////",
                    "edgecolor": "0.5",
                    "label": "status: not trusted",
                },
            ),
        ):
            panel.fill_between(place, row - 0.33, row + 0.33, where=chosen, linewidth=0, **look)
        resets = axis.place[one.estimates["sample"][one.estimates["reset"]]]
        label = "reset: the past is given up"
        rows = np.full(resets.size, row)
        panel.plot(resets, rows, "|", color="black", markersize=11, mew=1.6, label=label)
    panel.set(yticks=range(len(followed)), ylim=(len(followed) - 0.5, -0.5))
    panel.set_yticklabels([label_text(name, 14) for name in followed], fontsize=8)


def _event(upper: Axes, lower: Axes, drawn: _Drawn, event: int) -> None:
    """One slip event: estimates over measured adhesion, and slip below; seconds from its begin."""
    log, _, styles, top = drawn
    assert log.time is not None
    begin, end = log.events[event]
    window = slice(*np.searchsorted(log.time, [begin, end]))
    axis = _Axis(log.time - begin, "")
    used = np.isin(np.arange(window.start, window.stop), log.used)
    for panel, values in ((upper, np.abs(log.adhesion)), (lower, log.slip)):
        for chosen, colour, size, label in (
            (~used, _PASSED_OVER, 2.0, "measured, not used"),
            (used, _USED, 3.0, "measured"),
        ):
            panel.plot(
                axis.place[window][chosen],
                values[window][chosen],
                ".",
                color=colour,
                markersize=size,
                zorder=1,
                label=label,
            )
        light_frame(panel)
    _estimates(upper, axis, drawn)
    for name, one in drawn.followed.items():
        place = axis.place[one.estimates["sample"][one.estimates["reset"]]]
        upper.plot(
            place, np.full(place.size, 0.05 * top), "|", color=styles[name]["color"], markersize=9
        )
    upper.set(ylim=(0.0, top), xlim=(0.0, end - begin))
    lower.set_ylim(*_reach(log))
    upper.tick_params(labelbottom=False)
    lower.set_xlabel("time in the event (s)", fontsize=9)


def _reach(log: Log) -> tuple[float, float]:
    """The ends of the axis of slip in the events: those of the samples used, and a little more."""
    slip = log.slip[log.used]
    end = 0.1 * float(np.abs(slip).max())
    return min(0.0, float(slip.min())) - end, max(0.0, float(slip.max())) + end
