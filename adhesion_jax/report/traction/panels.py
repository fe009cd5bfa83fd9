"""Figures as data: panels with lines and with the numbers that a paper prints."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, SymmetricalLogLocator
from numpy.typing import ArrayLike

from adhesion_jax.report.style import light_frame, line_styles, one_legend

#: The colour of published numbers; in grey print their markers or dots distinguish them.
_PUBLISHED = "#7A0019"


class Line(NamedTuple):
    label: str
    x: ArrayLike
    y: ArrayLike


class Mark(NamedTuple):
    """A published number: a point, or a dotted line if one of its coordinates is not printed."""

    label: str
    x: float | None = None
    y: float | None = None


class Panel(NamedTuple):
    title: str
    x_label: str
    y_label: str
    lines: Sequence[Line]
    marks: Sequence[Mark] = ()
    limits: tuple[float, float] | None = None  # of y
    ratio: bool = False  # the axis of x is logarithmic
    linear: float | None = None  # of y: beyond it, to both sides, the axis is logarithmic


def draw(path: Path, panels: Sequence[Panel]) -> None:
    """The panels in a grid with one legend; a label has the same style in every panel."""
    columns = 2 if len(panels) == 4 else min(len(panels), 3)
    rows = -(-len(panels) // columns)
    figure = Figure(figsize=(4.3 * max(columns, 1.4), 3.1 * rows + 0.8), layout="constrained")
    alike = len({panel.y_label for panel in panels}) == 1
    axes = figure.subplots(rows, columns, sharey=alike, squeeze=False).ravel()
    for axis in axes[len(panels) :]:
        axis.set_axis_off()
    labels = dict.fromkeys(line.label for panel in panels for line in panel.lines)
    styles = line_styles(list(labels))
    for axis, panel in zip(axes, panels, strict=False):
        draw_lines(axis, panel.lines, styles)
        _mark(axis, panel.marks)
        axis.set(title=panel.title, xlabel=panel.x_label, ylabel=panel.y_label)
        if panel.limits is not None:
            axis.set_ylim(*panel.limits)
        if panel.ratio:
            axis.set_xscale("log")
            axis.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
        if panel.linear is not None:
            axis.set_yscale("symlog", linthresh=panel.linear)
            axis.yaxis.set_major_locator(SymmetricalLogLocator(base=100, linthresh=panel.linear))
        light_frame(axis)
    one_legend(figure, axes, loc="outside lower center", ncols=4, frameon=True)
    figure.savefig(path, dpi=110)


def draw_lines(axis: Axes, lines: Sequence[Line], styles: Mapping[str, Mapping[str, Any]]) -> None:
    """Draws the lines, each in the colour and the dashes of its label."""
    for line in lines:
        style = {key: styles[line.label][key] for key in ("color", "linestyle")}
        axis.plot(np.asarray(line.x), np.asarray(line.y), label=line.label, lw=1.3, **style)


def _mark(axis: Axes, marks: Sequence[Mark]) -> None:
    for mark in marks:
        if mark.x is None and mark.y is not None:
            axis.axhline(mark.y, color=_PUBLISHED, ls=":", lw=1.4, label=mark.label)
        elif mark.y is None and mark.x is not None:
            axis.axvline(mark.x, color=_PUBLISHED, ls=":", lw=1.4, label=mark.label)
        elif mark.x is not None and mark.y is not None:
            axis.plot(mark.x, mark.y, "*", color=_PUBLISHED, markersize=11, label=mark.label)
