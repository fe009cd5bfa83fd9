"""Figures and text of a study of discoveries."""

from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from adhesion_jax.report.style import line_styles


def draw_detection(path: Path, rates: pd.DataFrame) -> None:
    """Share of sets with a claim, and with the right one, against the visible misfit."""
    power = rates[rates["part"] == "power"]
    names = list(dict.fromkeys(power["group"]))
    styles = line_styles(names)
    figure = Figure(figsize=(11, 5.5), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    titles = {"detected": "an effect is claimed", "in_class": "the right one is in a class"}
    for axes, (quantity, title) in zip(panels, titles.items(), strict=True):
        shown = power[power["quantity"] == quantity]
        for place, name in enumerate(names):
            line = shown[shown["group"] == name].sort_values("visible")
            # Side by side, so that the bars of the intervals do not cover each other.
            shift = 1.03 ** (place - len(names) / 2)
            below = line["rate"] - line["low"]
            above = line["high"] - line["rate"]
            axes.errorbar(
                line["visible"] * shift,
                line["rate"],
                np.maximum(np.stack([below, above]), 0.0),
                label=name,
                capsize=2,
                elinewidth=0.6,
                **styles[name],
            )
        axes.set(xscale="log", ylim=(-0.03, 1.03), title=title)
        axes.set_xlabel("misfit left by the refitted base curve, rms (sigma of the noise)")
        axes.grid(color="0.9")
    ticks = sorted(set(power["visible"]))
    panels[0].set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    panels[0].minorticks_off()
    panels[0].set_ylabel("share of sets, with 95 % intervals (1)")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=5)
    figure.savefig(path, dpi=150)


def draw_confusion(path: Path, counts: pd.DataFrame) -> None:
    """Share of the sets of each planted effect, in grey; the number of sets is written in."""
    size = (4 + 0.32 * counts.shape[1], 2.5 + 0.3 * len(counts))
    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    totals = counts.sum(axis=1).to_numpy()
    shares = counts.to_numpy() / np.maximum(totals, 1)[:, None]
    image = axes.imshow(shares, cmap="Greys", vmin=0.0, vmax=1.0, aspect="auto")
    for (row, column), count in np.ndenumerate(counts.to_numpy()):
        if count:
            colour = "white" if shares[row, column] > 0.5 else "black"
            axes.text(column, row, f"{count}", ha="center", va="center", color=colour, fontsize=7)
    axes.set_xticks(range(counts.shape[1]), counts.columns.astype(str), rotation=90, fontsize=8)
    axes.set_yticks(range(len(counts)), counts.index.astype(str), fontsize=8)
    axes.set(xlabel="first name reported", ylabel="planted effect")
    figure.colorbar(image, ax=axes, label="share of the sets with that effect (1)", shrink=0.6)
    figure.savefig(path, dpi=150)


def study_text(rates: pd.DataFrame, sets: pd.DataFrame) -> str:
    """The shares, aligned; the time a set took."""
    lines = []
    nulls = rates[(rates["part"] == "null") & (rates["group"] == "all")]
    for row in nulls.to_dict("records"):
        lines.append(
            f"False claims on null sets: {row['hits']} of {row['count']}, "
            f"{row['rate']:.3f} [{row['low']:.3f}, {row['high']:.3f}]"
        )
    planted = rates[rates["part"] != "null"].copy()
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
