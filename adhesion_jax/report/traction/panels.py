"""Figures as data: panels with the lines of runs and with the numbers that a paper prints."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, SymmetricalLogLocator
from numpy.typing import ArrayLike, NDArray

from adhesion_jax.report.style import light_frame, line_styles, one_legend
from adhesion_jax.traction.loop import Trace
from adhesion_jax.traction.surface import RailSurface
from adhesion_jax.traction.systems.base import Case

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


Array = NDArray[np.float64]

TIME = "time (s)"


class SpeedUnit(NamedTuple):
    """Unit of the speeds in a figure: its name, and how many of it make 1 m/s."""

    name: str
    per_mps: float

    def of(self, speed: ArrayLike) -> Array:
        return self.per_mps * np.asarray(speed)


MPS, KMH = SpeedUnit("m/s", 1.0), SpeedUnit("km/h", 3.6)


class Shown(NamedTuple):
    """A case, its run without noise, and the title of its panels with the unit of their speeds."""

    case: Case
    trace: Trace
    title: str = ""
    unit: SpeedUnit = MPS


def shown(case: Case, trace: Trace) -> Shown:
    """The rows of the run up to the end of the driver's demand."""
    counts = np.asarray(trace.sample.counts)
    return Shown(case, jax.tree.map(lambda x: jnp.asarray(x[counts]), trace))


def by_method(
    shown: Sequence[Shown], *methods: str, title: str = "method", unit: SpeedUnit = MPS
) -> list[Shown]:
    """The runs of these methods, in their order, whose panels are called by method or scenario.

    If there are none: those of the only method, or of all methods in the first scenario.
    """
    found = [one for method in methods for one in shown if one.case.method == method]
    if not found:
        found = [one for one in shown if one.case.scenario == shown[0].case.scenario]
        found, title = (found, "method") if len(found) > 1 else ([*shown], title)
    return [one._replace(title=getattr(one.case, title), unit=unit) for one in found]


def mean_of_axles(values: ArrayLike) -> Array:
    return np.asarray(values).mean(axis=-1)


def surfaces(one: Shown) -> Mapping[str, RailSurface]:
    """The rails of a case by their names, each once."""
    found: dict[str, RailSurface] = {}
    for number, name in enumerate(one.case.segments):
        surface = one.case.rails.surface(jnp.asarray(number))
        if not any(eqx.tree_equal(surface, known) for known in found.values()):
            found[name] = surface
    return found


def curves(
    found: Mapping[str, RailSurface], train_speed: float, highest: float, unit: SpeedUnit = MPS
) -> list[Line]:
    """Adhesion over slip velocities up to the highest, which is in the unit."""
    slips = np.linspace(0.0, highest, 300)
    return [
        Line(name, slips, _adhesion(surface, slips / unit.per_mps, train_speed))
        for name, surface in found.items()
    ]


def with_best(
    title: str,
    lines: Sequence[Line],
    found: Mapping[str, RailSurface],
    best: Mapping[str, float],
    train_speed: float,
    unit: SpeedUnit = MPS,
) -> Panel:
    """The curves with a mark at each best slip, in the unit, that the paper prints of a rail."""
    marks = [
        Mark(
            "paper's best slip",
            slip,
            float(_adhesion(found[name], slip / unit.per_mps, train_speed)),
        )
        for name, slip in best.items()
        if name in found
    ]
    return Panel(title, f"slip velocity ({unit.name})", "adhesion (1)", lines, marks)


def _adhesion(surface: RailSurface, slips: ArrayLike, train_speed: float) -> Array:
    """Adhesion of the surface at slip velocities in m/s."""
    return np.asarray(surface(jnp.asarray(slips), jnp.asarray(train_speed)))


def over_time(
    one: Shown,
    label: str,
    lines: Mapping[str, ArrayLike],
    marks: Sequence[Mark] = (),
    limits: tuple[float, float] | None = None,
) -> Panel:
    """The course of some quantities of a run, means over its axles where they are of axles."""
    time = np.asarray(one.trace.time)
    drawn = [
        Line(name, time, mean_of_axles(values) if np.ndim(values) > time.ndim else values)
        for name, values in lines.items()
    ]
    return Panel(one.title, TIME, label, drawn, marks, limits)


def speeds(one: Shown) -> Panel:
    rim, train = one.unit.of(one.trace.rim_speed), one.unit.of(one.trace.sample.train_speed)
    return over_time(one, f"speed ({one.unit.name})", {"wheel at the rim": rim, "train": train})


def slips(
    one: Shown, best: Iterable[float], limits: tuple[float, float], of: str = "best slip"
) -> Panel:
    """With the slips `of` the paper, in the unit of the panel."""
    marks = [Mark(f"paper's {of}", y=slip) for slip in best]
    sample = one.trace.sample
    lines = {"slip": one.unit.of(sample.slip), "best slip": one.unit.of(sample.optimum)}
    return over_time(one, f"slip velocity ({one.unit.name})", lines, marks, limits)


def adhesions(one: Shown) -> Panel:
    sample = one.trace.sample
    lines = {"adhesion": sample.adhesion, "largest of the rail": sample.largest}
    return over_time(one, "adhesion (1)", lines)


def observed(one: Shown) -> Panel:
    sample = one.trace.sample
    return over_time(one, "adhesion (1)", {"observed": sample.observed, "true": sample.adhesion})


def torques(one: Shown, marks: Sequence[Mark] = ()) -> Panel:
    torque = np.asarray(one.trace.sample.torque) / 1e3
    return over_time(one, "torque (kN m)", {"torque of a motor": torque}, marks)


def over_curves(one: Shown, lines: Sequence[Line]) -> Panel:
    """The operating point in traction over the adhesion curves, as far as they are drawn.

    It is the first line, which is solid: the curves are seen where it does not go.
    """
    rows = one.trace.sample
    driven = np.asarray(rows.counts) & (np.asarray(rows.direction) > 0)
    slip = one.unit.of(mean_of_axles(rows.slip))[driven]
    end = max(np.max(line.x) for line in lines)
    track = Line(
        "operating point",
        np.where(slip <= end, slip, np.nan),
        mean_of_axles(rows.adhesion)[driven],
    )
    label = f"slip velocity ({one.unit.name})"
    return Panel(one.title, label, "adhesion (1)", [track, *lines])
