"""Figures and text of a study of discoveries."""

from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.image import AxesImage

from adhesion_jax.report.style import line_styles


def draw_detection(path: Path, rates: pd.DataFrame) -> None:
    """Share of sets with a claim, and with the right one, against the visible misfit."""
    power = rates[rates["part"] == "power"]
    names = list(dict.fromkeys(power["group"]))
    lines = {"detected": "an effect is claimed", "in_class": "the planted one is in a class"}
    styles = line_styles(list(lines))
    rows = -(-len(names) // 3)
    figure = Figure(figsize=(11, 1.2 + 2.6 * rows), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(rows, 3, sharex=True, sharey=True, squeeze=False)
    for axes in panels.flat[len(names) :]:
        axes.set_axis_off()
    for axes, name in zip(panels.flat, names, strict=False):
        for place, (quantity, label) in enumerate(lines.items()):
            line = power[(power["group"] == name) & (power["quantity"] == quantity)]
            line = line.sort_values("visible")
            spread = [line["rate"] - line["low"], line["high"] - line["rate"]]
            axes.errorbar(
                # Side by side, so that the bars of the intervals do not cover each other.
                line["visible"] * (0.97, 1.03)[place],
                line["rate"],
                np.maximum(np.stack(spread), 0.0),
                label=label,
                capsize=3,
                **styles[quantity],
            )
        axes.set(xscale="log", ylim=(-0.05, 1.05), title=name)
        axes.grid(color="0.9")
    ticks = sorted(set(power["visible"]))
    panels[0, 0].set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    panels[0, 0].minorticks_off()
    figure.supxlabel("misfit left by the refitted base curve, rms (sigma of the noise)")
    figure.supylabel("share of sets, with 95 % intervals (1)")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=2)
    figure.savefig(path, dpi=150)


def draw_confusion(path: Path, counts: pd.DataFrame, rates: pd.DataFrame) -> None:
    """Share of the sets of each planted effect, in grey; the number of sets is written in.

    On the right, of the same sets, those with the planted effect in a class that was reported.
    """
    figure = Figure(
        figsize=(4.5 + 0.26 * counts.shape[1], 2.5 + 0.24 * len(counts)), layout="constrained"
    )
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2, sharey=True, width_ratios=(counts.shape[1], 1))
    totals = np.maximum(counts.sum(axis=1).to_numpy(), 1)[:, None]
    chosen = rates[(rates["part"] == "confusion") & (rates["quantity"] == "in_class")]
    hits = chosen.set_index("group")["hits"].reindex(counts.index).to_numpy()[:, None]
    image = _grey(left, counts.to_numpy(), totals)
    _grey(right, hits, totals)
    left.set_xticks(range(counts.shape[1]), counts.columns.astype(str), rotation=90)
    left.set_yticks(range(len(counts)), counts.index.astype(str))
    left.set(xlabel="first name reported", ylabel="planted effect")
    right.set_xticks([0], ["in a class"], rotation=90)
    label = "share of the sets with that effect (1); numbers: sets"
    figure.colorbar(image, ax=[left, right], label=label, fraction=0.03, pad=0.02, aspect=35)
    figure.savefig(path, dpi=150)


def _grey(axes: Axes, counts: np.ndarray, totals: np.ndarray) -> AxesImage:
    shares = counts / totals
    image = axes.imshow(shares, cmap="Greys", vmin=0.0, vmax=1.0, aspect="auto")
    for (row, column), count in np.ndenumerate(counts):
        if count:
            colour = "white" if shares[row, column] > 0.5 else "black"
            axes.text(column, row, f"{count:.0f}", ha="center", va="center", color=colour)
    return image


def study_text(rates: pd.DataFrame, sets: pd.DataFrame) -> str:
    """The shares, aligned; the time a set took."""
    lines = []
    nulls = rates[(rates["part"] == "nothing") & (rates["group"] == "all")]
    for row in nulls.to_dict("records"):
        lines.append(
            f"False claims on null sets: {row['hits']} of {row['count']}, "
            f"{row['rate']:.3f} [{row['low']:.3f}, {row['high']:.3f}]"
        )
    planted = rates[rates["part"] != "nothing"].copy()
    if len(planted):
        planted["share"] = [
            f"{rate:.2f} [{low:.2f}, {high:.2f}]"
            for rate, low, high in zip(
                planted["rate"], planted["low"], planted["high"], strict=True
            )
        ]
        planted["sigma"] = [f"{v:g}" if np.isfinite(v) else "as drawn" for v in planted["visible"]]
        wide = planted.pivot_table(
            index=["part", "group", "sigma"],
            columns="quantity",
            values="share",
            aggfunc="first",
            sort=False,
        )
        lines += ["", wide.reset_index().to_string(index=False)]
    seconds = sets["seconds"]
    lines += [
        "",
        f"Seconds a set: median {seconds.median():.2f}, 95 % below {seconds.quantile(0.95):.2f}.",
    ]
    return "\n".join(lines)
