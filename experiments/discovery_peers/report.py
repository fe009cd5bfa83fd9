"""The discovery beside general methods: what each came to over all sets, in words and drawn."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from adhesion_jax.report.style import line_styles

#: This project's own discovery, beside the peers.
THIS = "discovery"

#: A removed share counts as better only if it is larger by at least this.
BETTER = 0.05


def summarised(rows: pd.DataFrame) -> pd.DataFrame:
    """One row for each method: shares removed, names right and false, harm done, seconds a set."""
    table = []
    for method in dict.fromkeys(rows["method"]):
        own = rows[rows["method"] == method]
        null = own["planted"] == "nothing"
        real = own[~null]
        removed = real["removed"].dropna()
        table.append(
            {
                "method": method,
                "sets": len(real),
                "hidden": int(real["hidden"].sum()),
                "hidden_named": int(real["named"].sum()),
                "removed_median": removed.median(),
                "removed_lower_quartile": removed.quantile(0.25),
                "removed_lowest_decile": removed.quantile(0.1),
                "removed_90": int((removed >= 0.9).sum()),
                "removed_of": len(removed),
                "sets_with_false_name": int((real["false_names"] > 0).sum()),
                "nulls": int(null.sum()),
                "nulls_with_name": int((own[null]["false_names"] > 0).sum()),
                "worse": int(real["worse"].sum()),
                "nulls_worse": int(own[null]["worse"].sum()),
                "seconds_median": own["seconds"].median(),
            }
        )
    return pd.DataFrame(table)


def beaten(rows: pd.DataFrame) -> pd.DataFrame:
    """Sets on which a general method removes clearly more than the discovery, and by how much."""
    removed = rows.pivot_table(index=["set", "planted"], columns="method", values="removed")
    if THIS not in removed:
        return pd.DataFrame()
    others = removed.drop(columns=THIS)
    lost = others.max(axis=1) > removed[THIS] + BETTER
    return pd.DataFrame(
        {
            THIS: removed.loc[lost, THIS],
            "removed": others[lost].max(axis=1),
            "by": others[lost].idxmax(axis=1) if lost.any() else "",
        }
    ).reset_index()


def peers_text(rows: pd.DataFrame) -> str:
    """The table as text, and the sets on which a general method is better."""
    summary = summarised(rows)
    quantiles = [f"removed_{name}" for name in ("median", "lower_quartile", "lowest_decile")]
    three = summary[quantiles].map("{:.3f}".format)
    shown = pd.DataFrame(
        {
            "method": summary["method"],
            "hidden effects named": _of(summary["hidden_named"], summary["hidden"]),
            "removed, median / lower quartile / lowest decile": three.agg(" / ".join, axis=1),
            "removed >= .9": _of(summary["removed_90"], summary["removed_of"]),
            "false name": _of(summary["sets_with_false_name"], summary["sets"]),
            "null sets with a name": _of(summary["nulls_with_name"], summary["nulls"]),
            "made worse": _of(summary["worse"], summary["sets"]),
            "null sets made worse": _of(summary["nulls_worse"], summary["nulls"]),
            "seconds per set": summary["seconds_median"].map("{:.2f}".format),
        }
    )
    lines = ["On held-out runs, for the sets with hidden effects; null sets have none"]
    lines.append(shown.to_string(index=False))
    lost = beaten(rows)
    if len(lost):
        lines += ["", f"A general method removes more by {BETTER:g} of"]
        lines.append(lost.to_string(index=False, float_format="{:.3f}".format))
    return "\n".join(lines)


def draw_peers(path: Path, rows: pd.DataFrame) -> None:
    """Share of the removable error that each method removes, sets in the order of the first."""
    real = rows[rows["planted"] != "nothing"].dropna(subset=["removed"])
    methods = list(dict.fromkeys(rows["method"]))
    styles = line_styles(methods)
    first = real[real["method"] == methods[0]].sort_values("removed")
    order = list(first["set"])
    figure = Figure(figsize=(10, 2.5 + 0.28 * max(len(order), 4)), layout="constrained")
    axes = figure.subplots()
    for place, method in enumerate(methods):
        own = real[real["method"] == method].set_index("set").reindex(order)
        shift = 0.12 * (place - (len(methods) - 1) / 2)
        style: dict[str, Any] = {**styles[method], "linestyle": "none"}
        axes.plot(
            np.clip(own["removed"].to_numpy(float), -0.3, None),
            np.arange(len(order)) + shift,
            label=method,
            **style,
        )
    planted = first.set_index("set")["planted"]
    axes.set_yticks(range(len(order)), [f"{name}: {planted[name]}" for name in order])
    axes.axvline(0.0, color="0.3", linewidth=0.8)
    axes.axvline(1.0, color="0.3", linewidth=0.8, linestyle="--")
    axes.grid(axis="y", color="0.9")
    axes.set(
        xlim=(-0.33, 1.08),
        xlabel="share of the removable squared error removed\n"
        "on held-out runs (1); left edge: -.3 or less",
        ylabel="set: planted effects",
    )
    figure.legend(loc="outside upper center", ncols=len(methods))
    figure.savefig(path, dpi=150)


def _of(count: pd.Series, total: pd.Series) -> list[str]:
    return [f"{part} of {whole}" for part, whole in zip(count, total, strict=True)]
