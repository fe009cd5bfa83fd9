"""The table and the figures of speed."""

from collections.abc import Hashable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from adhesion_jax.report.style import light_frame, line_styles
from adhesion_jax.wording import number
from experiments.speed.gpu import PART

#: What the size of a part whose name begins with `scaling over` is.
_AXES = {
    "runs": "runs side by side",
    "points": "points of a run",
    "members": "members of the population",
}


def told(table: pd.DataFrame) -> str:
    """The table as text, a paragraph for each part, with the ratios and their range."""
    paragraphs = []
    for part, rows in table.groupby("part", sort=False):
        lines = [_line(row) for row in rows.to_dict("records")]
        wide = [max(len(line[column]) for line in lines) for column in range(3)]
        text = [
            "  ".join((line[0].ljust(wide[0]), line[1].rjust(wide[1]), line[2].rjust(wide[2])))
            + (f"  {line[3]}" if line[3] else "")
            for line in lines
        ]
        paragraphs.append("\n".join([f"{part}: {_units(rows)}", *text]))
    return "\n\n".join(paragraphs)


def _units(rows: pd.DataFrame) -> str:
    """What the rates of a part are of, and per which second."""
    part, unit = rows["part"].iloc[0], rows["unit"].iloc[0]
    by_the_clock = part == "whole job" or part.startswith(PART)
    return f"{unit} per {'second by the clock' if by_the_clock else 'CPU-second of one core'}"


def _line(row: Mapping[Hashable, Any]) -> tuple[str, str, str, str]:
    name = str(row["name"])
    if str(row["part"]).startswith("scaling"):
        name = f"{name}, {row['size']:.0f}"
    remarks = [row["remark"]] if isinstance(row["remark"], str) and row["remark"] else []
    if np.isfinite(row["memory_mb"]):
        remarks.append(f"{row['memory_mb']:.0f} MB")
    if np.isfinite(row["compile_seconds"]):
        remarks.append(f"{row['compile_seconds']:.1f} CPU-seconds to compile or load")
    remark = ", ".join(remarks)
    if not np.isfinite(row["rate"]):
        return name, "", "", remark
    ratio = ""
    if np.isfinite(row["ratio"]) and row["name"] != row["peer"]:
        ends = number(row["ratio_lowest"]), number(row["ratio_highest"])
        ratio = f"{number(row['ratio'])} times {row['peer']} ({ends[0]} to {ends[1]})"
    return name, number(row["rate"]), ratio, remark


def draw_rates(path: Path, table: pd.DataFrame) -> None:
    """A bar for each method with the range of its turns, and its ratio to the peer beside it."""
    shown = table[table["rate"].notna() & table["peer"].fillna("").ne("")]
    parts = [part for part, _ in shown.groupby("part", sort=False)]
    counts = [int(np.sum(shown["part"] == part)) for part in parts]
    height = 0.24 * sum(counts) + 0.85 * len(parts)
    figure = Figure(figsize=(8.5, height), layout="constrained")
    axes = figure.subplots(len(parts), height_ratios=[count + 0.5 for count in counts])
    for axis, part in zip(np.atleast_1d(axes), parts, strict=True):
        rows = shown[shown["part"] == part]
        rate = rows["rate"].to_numpy()
        spread = np.array([rate - rows["lowest"], rows["highest"] - rate])
        peers = rows["name"].eq(rows["peer"])
        colours = np.where(peers, "0.35", "0.75")
        bars = axis.barh(rows["name"], rate, xerr=spread, color=colours, ecolor="black", capsize=2)
        ratios = [
            "peer" if own else f"{number(ratio)} ×" if np.isfinite(ratio) else ""
            for own, ratio in zip(peers, rows["ratio"], strict=True)
        ]
        axis.bar_label(bars, ratios, padding=6, fontsize=8)
        axis.set_xscale("log")
        axis.set_xlim(rate.min() / 3, rate.max() * 12)
        axis.invert_yaxis()
        axis.tick_params(which="both", labelsize=7)
        light_frame(axis)
        axis.set_title(part, loc="left", fontsize=9)
        axis.set_xlabel(_units(rows), fontsize=8)
    figure.savefig(path, dpi=150)


def draw_scaling(path: Path, table: pd.DataFrame) -> None:
    """The rate over the number of runs, points, members and cores."""
    figure = Figure(figsize=(8.5, 6.5), layout="constrained")
    panels = dict(zip((*_AXES, "cores"), figure.subplots(2, 2).ravel(), strict=True))
    names = ["ml-exact", "lm", "differential evolution"]
    styles = line_styles(names)
    for along, words in _AXES.items():
        axis, rows = panels[along], table[table["part"] == f"scaling over {along}"]
        for name, of_method in rows.groupby("name", sort=False):
            ends = [
                of_method["rate"] - of_method["lowest"],
                of_method["highest"] - of_method["rate"],
            ]
            axis.errorbar(
                of_method["size"],
                of_method["rate"],
                ends,
                label=name,
                capsize=2,
                **styles[str(name)],
            )
        axis.set_xscale("log", base=2)
        axis.set_xticks(
            sorted(set(rows["size"])), [f"{size:g}" for size in sorted(set(rows["size"]))]
        )
        axis.set_xlabel(words)
        axis.set_ylabel("identifications per CPU-second")
    whole = table[(table["part"] == "whole job")]
    for name in names[:2]:
        rows = whole[whole["name"].str.startswith(f"{name},")].copy()
        rows = rows[rows.groupby("size")["rate"].transform("max") == rows["rate"]]
        panels["cores"].plot(rows["size"], rows["rate"], label=name, **styles[name])
    panels["cores"].set_xticks(sorted(set(whole["size"])))
    panels["cores"].set_xlabel("cores of a whole job")
    panels["cores"].set_ylabel("identifications per second")
    for along, axis in panels.items():
        if along == "cores":
            axis.set_ylim(bottom=0)
        else:
            axis.set_yscale("log")
        light_frame(axis)
        axis.legend(frameon=False, fontsize=8)
    figure.savefig(path, dpi=150)
