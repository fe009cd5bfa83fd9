"""The operating point that moves over the adhesion curves when the rail changes."""

from pathlib import Path
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from adhesion_jax.report.style import light_frame, line_styles
from adhesion_jax.report.traction.panels import (
    Array,
    Line,
    Shown,
    curves,
    draw_lines,
    mean_of_axles,
)

#: The operating point is shown from this time before the switch on, s.
_BEFORE = 1.0

#: The operating point is shown up to this time after the switch, s.
_AFTER = 4.0

#: Number of frames of the moving picture.
_FRAMES = 80

#: Frames of the moving picture per second.
_RATE = 16


class _Passage(NamedTuple):
    """The time around the first switch: two curves, and the operating point [rows]."""

    title: str
    lines: list[Line]
    time: Array  # since the switch, s
    slip: Array
    adhesion: Array


def operating_point(one: Shown) -> Figure:
    """The whole passage in one figure; the colour of a point, from dark to bright, is its time."""
    passage = _passage(one)
    figure, axis = _frame(passage)
    axis.plot(passage.slip, passage.adhesion, color="0.75", lw=0.8, zorder=1)
    points = axis.scatter(passage.slip, passage.adhesion, c=passage.time, cmap="viridis", s=9)
    figure.colorbar(points, ax=axis, label="time since the switch (s)")
    return figure


def animate_operating_point(path: Path, one: Shown) -> None:
    """The same as a moving picture (GIF)."""
    passage = _passage(one)
    figure, axis = _frame(passage)
    (trail,) = axis.plot([], [], color="0.6", lw=0.9)
    (point,) = axis.plot([], [], "o", color="#7A0019", ms=8)
    told = axis.text(0.98, 0.03, "", transform=axis.transAxes, ha="right")
    rows = np.linspace(0, len(passage.time) - 1, min(_FRAMES, len(passage.time))).astype(int)

    def show(row: int) -> None:
        trail.set_data(passage.slip[: row + 1], passage.adhesion[: row + 1])
        point.set_data(passage.slip[row : row + 1], passage.adhesion[row : row + 1])
        told.set_text(f"{passage.time[row]:+.2f} s from the switch")

    FuncAnimation(figure, show, frames=[int(row) for row in rows]).save(
        path, PillowWriter(fps=_RATE), dpi=80
    )


def _passage(one: Shown) -> _Passage:
    rows = one.trace.sample
    segment, time = np.asarray(rows.segment), np.asarray(one.trace.time)
    # The first change of the surface; a run without a change is shown from its beginning.
    changes = np.nonzero(np.diff(segment))[0]
    at = int(changes[0]) + 1 if len(changes) else 0
    seen = (time >= time[at] - _BEFORE) & (time <= time[at] + _AFTER)
    slip, adhesion = mean_of_axles(rows.slip)[seen], mean_of_axles(rows.adhesion)[seen]
    found = {
        one.case.segments[segment[row]]: one.case.rails.surface(jnp.asarray(segment[row]))
        for row in (max(at - 1, 0), at)
    }
    highest = max(1.2 * float(slip.max()), 2.0 * float(np.abs(mean_of_axles(rows.optimum)[at])))
    lines = curves(found, float(rows.train_speed[at]), highest)
    title = f"{one.case.scenario}: {one.case.method}"
    return _Passage(title, lines, time[seen] - time[at], slip, adhesion)


def _frame(passage: _Passage) -> tuple[Figure, Axes]:
    figure = Figure(figsize=(7.0, 4.6), layout="constrained")
    axis = figure.subplots()
    draw_lines(axis, passage.lines, line_styles([line.label for line in passage.lines]))
    axis.set(title=passage.title, xlabel="slip velocity (m/s)", ylabel="adhesion (1)")
    figure.legend(loc="outside lower center", ncols=2, title="rail")
    light_frame(axis)
    return figure, axis
