"""Styles that distinguish lines in colour and in grey, and the axis of slip."""

from collections.abc import Container, Iterable, Mapping
from io import BytesIO
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure, FigureBase
from matplotlib.ticker import FixedLocator, NullLocator

#: Okabe and Ito's colours, which colour-blind readers can distinguish, the darkest first.
_COLOURS = ("#000000", "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#7F7F7F")
_DASHES = ("-", "--", "-.", ":", (0, (5, 1)), (0, (3, 1, 1, 1)), (0, (1, 1)), (0, (8, 3)))
_MARKERS = ("o", "s", "^", "D", "v", "x", "+", "*")


def line_styles(names: list[str]) -> dict[str, dict[str, object]]:
    """A colour, a dash and a marker for each name.

    A colour comes back with the next dash: no two of the first 64 share both.
    """
    count = len(_COLOURS)
    return {
        name: {
            "color": _COLOURS[i % count],
            "linestyle": _DASHES[(i + i // count) % count],
            "marker": _MARKERS[(i + i // count) % count],
        }
        for i, name in enumerate(names)
    }


#: The axis of slip is linear up to this share of the largest slip, and logarithmic beyond it.
_LINEAR = 1 / 30

#: How the label of such an axis tells that.
STRETCHED = "stretched near 0"


def slip_axis(axis: Axes, low: float, high: float, gap: float = 0.045) -> None:
    """Slip from `low` to `high`, stretched near 0: the rise is as wide as the fall.

    The scale is asinh(slip / width), which leaves a curve its slope at slip 0. Ticks keep `gap` of
    the length of the longer side from each other.
    """
    end = max(high, -low)
    axis.set_xscale("asinh", linear_width=_LINEAR * end)
    # If braking is shown as well, each side has half of the axis.
    ticks = _ticks(end, gap * (2 if low < 0 < high else 1))
    both = [-tick for tick in reversed(ticks) if 0 < tick <= -low] + [t for t in ticks if t <= high]
    axis.xaxis.set_major_locator(FixedLocator(both))
    axis.xaxis.set_minor_locator(NullLocator())
    axis.xaxis.set_major_formatter(lambda slip, _: f"{slip:g}")


def _ticks(end: float, gap: float) -> list[float]:
    """0 and round numbers up to `end`, closer to each other near zero than on a linear axis."""
    decade = 10.0 ** np.floor(np.log10(end))
    steps = decade * np.array([0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0])
    kept = [0.0]
    # From the end inwards, where the round numbers are that a reader looks for.
    last = np.inf
    for tick in reversed(steps[(steps <= end) & (steps >= end / 60)]):
        place = np.arcsinh(tick / (_LINEAR * end)) / np.arcsinh(1 / _LINEAR)
        if min(last - place, place) >= gap:
            kept.append(float(tick))
            last = place
    return sorted(kept)


#: Colours of a law before effects were added (open, dashed) and after it (filled, solid), and of
#: points.
BEFORE, AFTER, POINT = "#D55E00", "#08306B", "#6B6B6B"
MARKS: Mapping[str, Mapping[str, Any]] = {
    "before": {"color": BEFORE, "marker": "s", "markerfacecolor": "white"},
    "after": {"color": AFTER, "marker": "o", "markerfacecolor": AFTER},
}

#: Largest number of points that are drawn: more make the figure slow and cannot be distinguished.
_MOST_POINTS = 4000


def thinned(points: pd.DataFrame) -> pd.DataFrame:
    """Every n-th point, with the smallest n that leaves few enough points to draw."""
    return points.iloc[:: -(-len(points) // _MOST_POINTS) or 1]


class Shown(Figure):
    """A figure that a notebook shows by itself."""

    def _repr_png_(self) -> bytes:
        picture = BytesIO()
        self.savefig(picture, format="png", dpi=80)
        return picture.getvalue()


def panels(
    count: int, height: float, label: str, apart: Container[int] = ()
) -> tuple[Figure, list[Axes]]:
    """Small multiples of one height and one axis of this label, three in a row.

    The panels numbered in `apart` have each a scale of its own. There is room above for a title of
    two lines, and below for a legend of one. Their places are set in inches: a layout engine takes
    longer than to draw them.
    """
    columns = min(count, 3)
    lines = -(-count // columns)
    wide, gap, below, above = 3.0 if columns > 1 else 5.0, 0.9, 0.95, 0.45
    size = (1.05 + columns * (wide + 0.3), lines * (height + gap) - gap + below + above)
    figure = Figure(figsize=size)
    axes = list(figure.subplots(lines, columns, squeeze=False).ravel())
    figure.subplots_adjust(
        left=0.95 / size[0],
        right=1 - 0.2 / size[0],
        bottom=below / size[1],
        top=1 - above / size[1],
        wspace=0.3 / wide,
        hspace=gap / height,
    )
    alike = [place for place in range(count) if place not in apart]
    for place in alike:
        axes[place].sharey(axes[alike[0]])
        # A neighbour on the left with the same scale has its numbers.
        axes[place].tick_params(labelleft=place % columns == 0 or place - 1 in apart)
    for axis in axes[:count]:
        light_frame(axis)
    for axis in axes[:count:3]:
        axis.set_ylabel(label)
    for axis in axes[count:]:
        axis.set_axis_off()
    return figure, axes[:count]


def one_legend(figure: FigureBase, axes: Iterable[Axes], **how: Any) -> None:
    """One legend for some panels, each label once; by default below those of `panels`."""
    found = [axis.get_legend_handles_labels() for axis in axes]
    entries = {label: handle for pair in found for handle, label in zip(*pair, strict=True)}
    default = {"loc": "lower center", "ncols": 3, "frameon": False, "fontsize": 9}
    figure.legend([*entries.values()], [*entries], **{**default, **how})


def light_frame(axis: Axes) -> None:
    axis.grid(color="0.92", linewidth=0.6)
    axis.set_axisbelow(True)
    axis.spines[["top", "right"]].set_visible(False)


def label_text(text: str, longest: int = 46) -> str:
    """Text from a user's file as a label: cut if it is long, its dollars escaped."""
    cut = text if len(text) <= longest else text[: longest - 1] + "…"
    return cut.replace("$", r"\$")
