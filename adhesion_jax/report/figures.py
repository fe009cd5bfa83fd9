"""Figures of a Monte Carlo campaign, drawn from its tables and its stored estimates."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from adhesion_jax.report.style import line_styles

#: Estimates of one identifier: (identifier, columns) to a table.
Estimates = Callable[[str, list[str]], pd.DataFrame]

LABELS = {
    "c1": "$c_1$ (1)",
    "c2": "$c_2$ (1)",
    "c3": "$c_3$ (1)",
    "mu_max": r"maximum adhesion $\mu_{max}$ (1)",
    "slip_opt": r"slip at the peak $\lambda_{opt}$ (1)",
}

_BINS = 60


def histogram(path: Path, summary: pd.DataFrame, estimates: Estimates, blocks: list[int]) -> None:
    """mu_max of every identifier, a panel a rail, with the truth and the bound's width.

    The first blocks after a switch are left out, as they are in the summary. Estimates beyond
    the panel are counted in its legend (He et al. 2018, Fig. 12 and 17).
    """
    rows = summary[summary["quantity"] == "mu_max"]
    rails = list(dict.fromkeys(rows["rail"]))
    names = list(dict.fromkeys(rows["identifier"]))
    styles = line_styles(names)
    figure = Figure(figsize=(5.2 * len(rails), 4.6), layout="constrained")
    axes = figure.subplots(1, len(rails), squeeze=False)[0]
    truth = rows.groupby("rail")["truth"].first()
    bound = rows.groupby("rail")["crlb"].first()
    for name in names:
        table = estimates(name, ["rail", "block", "mu_max"])
        table = table[table["block"].isin(blocks)]
        for rail, axis in zip(rails, axes, strict=True):
            centre, width = truth[rail], 6 * bound[rail]
            edges = np.linspace(centre - width, centre + width, _BINS + 1)
            values = table.loc[table["rail"] == rail, "mu_max"].to_numpy()
            density = np.histogram(values, edges)[0] / (len(values) * np.diff(edges))
            outside = np.mean((values < edges[0]) | (values > edges[-1]))
            style = {key: styles[name][key] for key in ("color", "linestyle")}
            label = name if outside == 0 else f"{name} ({100 * outside:.1f} % outside)"
            axis.stairs(density, edges, label=label, linewidth=1.3, **style)
    for rail, axis in zip(rails, axes, strict=True):
        centre, width = truth[rail], bound[rail]
        axis.axvline(centre, color="0.4", linewidth=1)
        band = (centre - 1.96 * width, centre + 1.96 * width)
        axis.axvspan(*band, color="0.9", zorder=0, label="truth ± 1.96 × Cramér-Rao bound")
        axis.set(title=f"{rail} rail", xlabel=LABELS["mu_max"], ylabel="probability density (1)")
        axis.legend(fontsize=7, loc="upper left")
        axis.margins(y=0.35)
    figure.savefig(path, dpi=150)


def tracking(path: Path, truth: pd.DataFrame, estimates: Estimates, names: list[str]) -> None:
    """c1, c2, c3 and mu_max over the blocks: the median and the band from 5 to 95 %.

    A row a quantity, a column an identifier; `truth` has the columns block and quantities.
    """
    shown = ["c1", "c2", "c3", "mu_max"]
    figure = Figure(figsize=(2.6 * len(names) + 1, 8.5), layout="constrained")
    axes = figure.subplots(len(shown), len(names), sharex=True, sharey="row", squeeze=False)
    for name, column in zip(names, axes.T, strict=True):
        table = estimates(name, ["block", *shown]).groupby("block")
        low, middle, high = (table.quantile(q) for q in (0.05, 0.5, 0.95))
        for quantity, axis in zip(shown, column, strict=True):
            _band(axis, middle.index.to_numpy(), low[quantity], middle[quantity], high[quantity])
            axis.plot(truth["block"], truth[quantity], "k--", linewidth=1, label="truth")
        column[0].set_title(name, fontsize=10)
        column[-1].set_xlabel("block (1)")
    for quantity, axis in zip(shown, axes[:, 0], strict=True):
        axis.set_ylabel(LABELS[quantity])
    axes[0, 0].legend(fontsize=7, loc="upper right")
    figure.savefig(path, dpi=150)


def convergence(
    path: Path, checkpoints: pd.DataFrame, estimates: Estimates, slip_reached: list[float]
) -> None:
    """Estimates against the slip reached (He et al. 2018, Fig. 4 to 7).

    For every identifier the median and the band from 5 to 95 %, one panel a quantity; the grey
    band is the truth with the Cramer-Rao bound's 90 % width.
    """
    shown = ["c1", "c2", "c3", "mu_max"]
    names = list(dict.fromkeys(checkpoints["identifier"]))
    styles = line_styles(names)
    figure = Figure(figsize=(11, 8), layout="constrained")
    axes = figure.subplots(2, 2).ravel()
    slip = np.array(slip_reached)
    for name in names:
        table = estimates(name, ["block", *shown]).groupby("block")
        low, middle, high = (table.quantile(q) for q in (0.05, 0.5, 0.95))
        for quantity, axis in zip(shown, axes, strict=True):
            spread = np.array([middle[quantity] - low[quantity], high[quantity] - middle[quantity]])
            shift = (names.index(name) - (len(names) - 1) / 2) * 0.1 * (slip[1] - slip[0])
            axis.errorbar(
                slip + shift,
                middle[quantity],
                spread,
                label=name,
                markersize=3,
                linewidth=0.8,
                **styles[name],
            )
    for quantity, axis in zip(shown, axes, strict=True):
        rows = checkpoints[checkpoints["quantity"] == quantity]
        rows = rows[rows["identifier"] == names[0]]
        truth, bound = rows["truth"].to_numpy(), rows["crlb"].to_numpy()
        axis.fill_between(
            slip,
            truth - 1.645 * bound,
            truth + 1.645 * bound,
            color="0.88",
            zorder=0,
            label="truth ± 1.645 × Cramér-Rao bound",
        )
        axis.axhline(truth[0], color="0.4", linewidth=1)
        centre, reach = truth[0], 8 * np.median(bound)
        axis.set_ylim(centre - reach, centre + reach)
        axis.set(xlabel="slip reached (1)", ylabel=LABELS[quantity])
    axes[0].legend(fontsize=7)
    figure.savefig(path, dpi=150)


def _band(axis: Axes, x: np.ndarray, low: pd.Series, middle: pd.Series, high: pd.Series) -> None:
    axis.fill_between(x, low, high, step="mid", color="0.75", label="5 to 95 %")
    axis.step(x, middle, where="mid", color="#0072B2", linewidth=1.2, label="median")
