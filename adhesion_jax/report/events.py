"""The figure of a log and of the slip events that were cut out of it."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from adhesion_jax.data.events import Chosen, Events
from adhesion_jax.report.style import (
    AFTER,
    BEFORE,
    POINT,
    STRETCHED,
    light_frame,
    one_legend,
    slip_axis,
    thinned,
)

#: Name of the file.
EVENTS_FIGURE = "events.png"

#: Largest number of events that have a panel of their own, and panels in a row.
_PANELS, _COLUMNS = 12, 4

#: Least distance between two numbers of events, as a share of the axis of time.
_APART = 0.022

#: Units of time: name, seconds, shortest log for which it is used.
_UNITS = (("h", 3600.0, 5400.0), ("min", 60.0, 300.0), ("s", 1.0, 0.0))


def draw_events(folder: Path, logs: Sequence[Chosen]) -> None:
    """Whole logs with their events numbered, and below them adhesion over slip in each event.

    Several logs are drawn one after the other; nothing is drawn where no events were cut out. Where
    there are more events than panels, the panels show some of them, evenly spread.
    """
    cut = [log for log in logs if log.events is not None]
    if not cut:
        return
    title = Path(cut[0].points.name).name if len(cut) == 1 else f"{len(cut)} logs"
    events, points = _one_after_the_other(cut)
    chosen = events.table.iloc[
        np.unique(np.linspace(0, len(events.table) - 1, _PANELS).round().astype(int))
    ]
    lines = -(-len(chosen) // _COLUMNS)
    figure = Figure(figsize=(11, 5.2 + 2.5 * lines), layout="constrained")
    above, below = np.asarray(figure.subfigures(2, 1, height_ratios=(4.4, 0.8 + 2.5 * lines)))
    _log(above, title, events)
    _panels(below, events, chosen, points, lines)
    figure.savefig(folder / EVENTS_FIGURE, dpi=150)


def _one_after_the_other(logs: Sequence[Chosen]) -> tuple[Events, pd.DataFrame]:
    """The events and points of several logs as if of one, which has no time between them."""
    pairs = [(log.points.table, log.events) for log in logs if log.events is not None]
    if len(pairs) == 1:
        return pairs[0][1], pairs[0][0]
    end = 0.0
    moved, points = [], []
    for number, (rows, events) in enumerate(pairs, 1):
        late = end - float(events.overview["start_s"].iloc[0])
        times = ["start_s", "end_s"]
        overview, table = (
            one.assign(**{name: one[name] + late for name in times})
            for one in (events.overview, events.table)
        )
        name = f"{number}."
        moved.append(
            events._replace(overview=overview, table=table.assign(run=name + table["run"]))
        )
        points.append(rows.assign(run=name + rows["run"]))
        end = float(overview["end_s"].iloc[-1])
    return moved[0]._replace(
        table=pd.concat([one.table for one in moved], ignore_index=True),
        rows=sum(one.rows for one in moved),
        overview=pd.concat([one.overview for one in moved], ignore_index=True),
    ), pd.concat(points, ignore_index=True)


def _log(figure: SubFigure, title: str, events: Events) -> None:
    overview, table = events.overview, events.table
    begin = float(overview["start_s"].iloc[0])
    span = float(overview["end_s"].iloc[-1]) - begin
    unit, seconds, _ = next(one for one in _UNITS if span >= one[2])
    middle = ((overview["start_s"] + overview["end_s"]) / 2 - begin) / seconds
    fast = bool(overview["speed_high"].notna().any())
    axes = list(figure.subplots(2 if fast else 1, 1, sharex=True, squeeze=False)[:, 0])
    if fast:
        axes[0].fill_between(
            middle, 3.6 * overview["speed_low"], 3.6 * overview["speed_high"], **_BAND
        )
        axes[0].set(ylabel="vehicle speed (km/h)", ylim=(0, None))
    axes[-1].fill_between(middle, overview["slip_low"], overview["slip_high"], **_BAND)
    axes[-1].set(
        ylabel=_slip_label(events),
        xlabel=f"time from the beginning of the log ({unit})",
        xlim=(0, span / seconds),
    )
    ends = (table[["start_s", "end_s"]].to_numpy() - begin) / seconds
    for axis in axes:
        light_frame(axis)
        for pair in ends:
            axis.axvspan(*pair, color=BEFORE, alpha=0.35, linewidth=1.5, zorder=0.5)
    last = -np.inf
    for run, place in zip(table["run"], ends.mean(axis=1) * seconds / span, strict=True):
        if place - last < _APART:
            continue
        last = place
        axes[0].annotate(
            run,
            (place, 1.0),
            xycoords="axes fraction",
            xytext=(0, 3),
            textcoords="offset points",
            ha="center",
            fontsize=9,
            color=BEFORE,
            fontweight="bold",
        )
    count, share = len(table), f"{100 * events.share:.2f} %"
    figure.suptitle(
        f"{title}: {count} slip event{'s' if count > 1 else ''}, {share} of {events.rows:,} rows; "
        "bands reach from the smallest to the largest value",
        x=0.01,
        ha="left",
        fontsize=11,
        parse_math=False,  # a file may have dollars in its name
    )


def _slip_label(events: Events) -> str:
    return "slip ratio (1)" if events.slip == "slip_ratio" else "slip velocity (m/s)"


def _panels(
    figure: SubFigure, events: Events, chosen: pd.DataFrame, points: pd.DataFrame, lines: int
) -> None:
    shown = points[points["run"].isin(chosen["run"])]
    slip, adhesion = shown[events.slip], shown["adhesion"]
    axes = figure.subplots(lines, min(len(chosen), _COLUMNS), sharex=True, sharey=True)
    grid = np.atleast_1d(axes).ravel()
    low, high = min(0.0, 1.04 * float(slip.min())), max(0.0, 1.04 * float(slip.max()))
    for axis, (_, event) in zip(grid, chosen.iterrows(), strict=False):
        _event(axis, events, event, shown[shown["run"] == event["run"]])
    grid[0].set_xlim(low, high)
    slip_axis(grid[0], low, high, gap=0.16)  # the panels share it
    for axis in grid[len(chosen) :]:
        axis.set_axis_off()
    for axis in grid[: len(chosen)][-_COLUMNS:]:  # the lowest of each column
        axis.tick_params(labelbottom=True)
    margin = 0.04 * float(np.ptp(adhesion))
    grid[0].set_ylim(min(0.0, adhesion.min() - margin), max(0.0, adhesion.max() + margin))
    some = "" if len(chosen) == len(events.table) else f"; {len(chosen)} of the events"
    figure.supxlabel(f"{_slip_label(events)}, {STRETCHED}{some}", fontsize=10)
    figure.supylabel("adhesion (1)", fontsize=10)
    one_legend(figure, grid[:1], loc="outside upper left", ncols=2, markerscale=2.5)


def _event(axis: Axes, events: Events, event: pd.Series, rows: pd.DataFrame) -> None:
    """The points of one event: those before its largest slip, and those after it."""
    light_frame(axis)
    size = np.abs(rows[events.slip].to_numpy())
    top = rows["time_s"].to_numpy()[np.argmax(size)]
    for part, marker, colour, label in (
        (rows[rows["time_s"] <= top], "o", AFTER, "until the largest slip of the event"),
        (rows[rows["time_s"] > top], "x", POINT, "after it"),
    ):
        few = thinned(part)
        axis.plot(
            few[events.slip],
            few["adhesion"],
            linestyle="",
            marker=marker,
            markersize=2.2,
            markeredgewidth=0.6,
            color=colour,
            alpha=0.7,
            label=label,
        )
    axis.set_title(
        f"{event['run']}: {event['duration_s']:.1f} s, {event['rows']:,} rows", fontsize=9
    )


_BAND = {"color": AFTER, "linewidth": 0.8, "alpha": 0.9}
