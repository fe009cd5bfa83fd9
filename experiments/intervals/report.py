"""Figure and text of a study of the intervals of an identification."""

from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from adhesion_jax.report.style import light_frame

_NAMES = {"mu_max": "largest adhesion, mu_max", "slip_opt": "its slip, slip_opt"}
_STYLES = {"mu_max": ("#08306b", "o"), "slip_opt": ("#d95f02", "s")}


def draw_coverage(path: Path, rates: pd.DataFrame) -> None:
    """Coverage of each true curve and noise with its 95 % interval, and the widths beside it."""
    cells = rates[["truth", "noise"]].drop_duplicates().itertuples(index=False, name=None)
    places = {cell: -place for place, cell in enumerate(cells)}
    figure = Figure(figsize=(10, 1.6 + 0.36 * len(places)), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True, width_ratios=(1.6, 1))
    left.axvspan(0.93, 0.97, color="0.9", zorder=0, label="0.93 to 0.97")
    left.axvline(0.95, color="0.4", linewidth=0.8)
    for quantity, name in _NAMES.items():
        part = rates[rates["quantity"] == quantity]
        colour, marker = _STYLES[quantity]
        shift = 0.13 if quantity == "mu_max" else -0.13
        cells = zip(part["truth"], part["noise"], strict=True)
        heights = np.array([places[cell] for cell in cells]) + shift
        spread = [part["coverage"] - part["low"], part["high"] - part["coverage"]]
        left.errorbar(
            part["coverage"],
            heights,
            xerr=np.maximum(np.stack(spread), 0.0),
            color=colour,
            marker=marker,
            linestyle="none",
            capsize=2,
            label=name,
        )
        right.plot(part["width_ratio"], heights, color=colour, marker=marker, linestyle="none")
    names = [f"{truth}, {noise}" for truth, noise in places]
    left.set_yticks(list(places.values()), names)
    left.set(xlabel="share of intervals that hold the truth (1)", xlim=(None, 1.005))
    right.set(xlabel="median width over that\nof known, white (1)", xscale="log")
    ticks = [0.5, 1, 2, 3, 5, 10]
    right.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    right.minorticks_off()
    right.axvline(1.0, color="0.4", linewidth=0.8)
    for axes in (left, right):
        light_frame(axes)
    figure.legend(loc="outside upper center", ncols=3, frameon=False)
    figure.savefig(path, dpi=150)


def coverage_text(rates: pd.DataFrame) -> str:
    """The rates for a terminal."""
    shown = pd.DataFrame(
        {
            "true curve": rates["truth"],
            "noise": rates["noise"],
            "quantity": rates["quantity"],
            "sets": rates["sets"],
            "coverage [95 %]": [
                f"{row.coverage:.3f} [{row.low:.3f}, {row.high:.3f}]" for row in rates.itertuples()
            ],
            "median width": rates["width"].map("{:.5f}".format),
            "of the known curve's": rates["width_ratio"].map("{:.2f}".format),
        }
    )
    return shown.to_string(index=False)
