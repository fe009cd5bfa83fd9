"""Figures and text of a study of discoveries."""

from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage

from adhesion_jax.report.style import line_styles
from experiments.discovery_study.rates import MISSED, REMOVED


def draw_detection(path: Path, rates: pd.DataFrame) -> None:
    """Share of sets with a claim, and with the right one, against the visible misfit."""
    power = rates[rates["part"] == "power"]
    names = list(dict.fromkeys(power["group"]))
    lines = {"detected": "an effect is claimed", "in_class": "the planted effect is in a class"}
    styles = line_styles(list(lines))
    rows = -(-len(names) // 3)
    figure = Figure(figsize=(11, 1.2 + 2.6 * rows), layout="constrained")
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
    figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    figure.savefig(path, dpi=150)


def draw_confusion(path: Path, counts: pd.DataFrame, rates: pd.DataFrame) -> None:
    """Share of the sets of each planted effect, in grey; the number of sets is written in.

    On the right, of the same sets, those with the planted effect in a class that was reported.
    """
    figure = Figure(
        figsize=(4.5 + 0.26 * counts.shape[1], 2.5 + 0.24 * len(counts)), layout="constrained"
    )
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


def draw_random(path: Path, sets: pd.DataFrame) -> None:
    """Share removed of each random effect against its misfit, a panel for what it acts on."""
    chosen = sets[sets["part"] == "random"]
    kinds = {"level": "level of adhesion", "slip": "scale of the slip", "fall": "fall beyond peak"}
    figure = Figure(figsize=(11, 4.2), layout="constrained")
    panels = figure.subplots(1, 3, sharex=True, sharey=True)
    several = chosen["rests_on"].str.contains("*", regex=False)
    for axes, (kind, title) in zip(panels, kinds.items(), strict=True):
        for count, marker in (("one column", "o"), ("two columns", "s")):
            for named, face in ((True, "black"), (False, "white")):
                own = chosen[
                    (chosen["acts_on"] == kind)
                    & (several == (count == "two columns"))
                    & (chosen["all_named"] == named)
                ]
                axes.plot(
                    own["visible"],
                    own["removed"].clip(lower=-0.1),
                    linestyle="none",
                    marker=marker,
                    color="black",
                    markerfacecolor=face,
                    alpha=0.75,
                    label=f"{count}, {'all named' if named else 'not all named'}",
                )
        removed = chosen.loc[chosen["acts_on"] == kind, "removed"].dropna()
        axes.axhline(REMOVED, color="0.5", linewidth=0.8, linestyle="--")
        axes.set(
            xscale="log",
            ylim=(-0.12, max(1.05, float(chosen["removed"].max()) + 0.03)),
            title=f"{title}: {(removed >= REMOVED).sum()} of {len(removed)} above .9",
        )
        axes.grid(color="0.9")
    panels[0].set_xlim(0.45, 3.6)
    panels[0].set_xticks([0.5, 1.0, 2.0, 3.0], ["0.5", "1", "2", "3"])
    panels[0].minorticks_off()
    figure.supxlabel("misfit left by the refitted base curve, rms (sigma of the noise)")
    figure.supylabel(
        "removed of the removable squared error\non held-out runs (1; at the foot: -.1 or less)"
    )
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
    figure.savefig(path, dpi=150)


def study_text(rates: pd.DataFrame, removed: pd.DataFrame, sets: pd.DataFrame) -> str:
    """The random effects, then false claims and the other parts, then the time per set."""
    lines = _random_lines(rates, removed, sets)
    nulls = rates[rates["part"] == "nothing"]
    for row in nulls.to_dict("records"):
        if row["group"] in ("all", "autocorrelation slow"):
            of = "null sets" if row["group"] == "all" else "those with slow noise"
            lines.append(
                f"False claims on {of}: {row['hits']} of {row['count']}, "
                f"{row['rate']:.3f} [{row['low']:.3f}, {row['high']:.3f}]"
            )
    for parts in (("power", "confusion"), ("pair",), ("log",)):
        wide = _wide(rates[rates["part"].isin(parts)])
        lines += ["", wide.to_string(index=False)] if len(wide) else []
    lines.append("")
    for column, name in (("seconds", "Seconds per set"), ("cpu_seconds", "CPU seconds per set")):
        median, most, longest = sets[column].quantile([0.5, 0.95, 1.0])
        lines.append(f"{name}: median {median:.2f}, 95 % below {most:.2f}, longest {longest:.2f}.")
    return "\n".join(lines)


def _random_lines(rates: pd.DataFrame, removed: pd.DataFrame, sets: pd.DataFrame) -> list[str]:
    chosen = sets[sets["part"] == "random"]
    if not len(chosen):
        return []
    wide = _wide(rates[rates["part"] == "random"]).drop(columns=["part", "sigma"])
    three = removed[["median", "lower_quartile", "lowest_decile"]].map("{:.3f}".format)
    quantiles = removed[["group", "sets"]].assign(removed=three.agg(" / ".join, axis=1))
    table = quantiles.merge(wide, on="group").rename(
        columns={
            "removed": "removed, median / lower quartile / lowest decile",
            "all_named": "all columns named",
            "in_class": "one named",
            "removed_90": "removed >= .9",
            "missed": "removed < .1",
        }
    )
    lines = ["Random effects", table.to_string(index=False)]
    # A share is NaN if there is no error to remove; such a set does not count as missed.
    misses = chosen[chosen["removed"] < MISSED]
    if len(misses):
        told = misses[["seed", "base", "planted", "visible", "removed", "reported"]]
        lines += ["", "Missed:", told.to_string(index=False, float_format="{:.2f}".format)]
    return [*lines, ""]


def _wide(rates: pd.DataFrame) -> pd.DataFrame:
    """Rates with their intervals: a row for each group and strength, a column for each quantity."""
    told = rates.assign(
        share=[
            f"{rate:.2f} [{low:.2f}, {high:.2f}]"
            for rate, low, high in zip(rates["rate"], rates["low"], rates["high"], strict=True)
        ],
        sigma=[f"{value:g}" if np.isfinite(value) else "as drawn" for value in rates["visible"]],
    )
    return told.pivot_table(
        index=["part", "group", "sigma"],
        columns="quantity",
        values="share",
        aggfunc="first",
        sort=False,
    ).reset_index()
