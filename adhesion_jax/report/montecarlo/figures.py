"""Figures of a Monte Carlo campaign, drawn from its tables."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike, NDArray

from adhesion_jax.report.style import line_styles, one_legend

LABELS = {
    "c1": "$c_1$ (1)",
    "c2": "$c_2$ (1)",
    "c3": "$c_3$ (1)",
    "p1": "$p_1$ (1)",
    "p2": "$p_2$ (1)",
    "mu_max": r"maximum adhesion $\mu_{max}$ (1)",
    "slope": r"slope $d\mu/dv_s$ (s/m)",
    "slip_opt": r"slip at the peak $\lambda_{opt}$ (1)",
}

_SHORT = {"mu_max": r"$\mu_{max}$ (1)", "forgetting": "forgetting\nfactor (1)"}

#: Dots per inch; a figure of many panels is large and takes long to write.
_FEW_PANELS, _MANY_PANELS = 150, 110

_LEGEND: Mapping[str, Any] = {
    "loc": "outside lower center",
    "ncols": 5,
    "fontsize": 8,
    "frameon": True,
}

#: What the dashed lines of the histogram are.
_BEST = "normal distribution with the Cramér-Rao bound"

#: A share below this is rounding.
_NONE_OUTSIDE = 1e-9


def histogram(summary: pd.DataFrame, densities: pd.DataFrame) -> Figure:
    """mu_max by every identifier, a row each, with truth and bound; a panel per scenario and rail.

    `densities` has a row for each scenario, rail, identifier and bin (lower, upper, density). The
    rows of a panel have one scale, which its title tells. The share of estimates beyond the axis is
    written in the row. After He et al. 2018, Fig. 12, 17.
    """
    peaks = summary[summary["quantity"] == "mu_max"]
    drawn = dict(iter(densities.groupby(["scenario", "rail", "identifier"], sort=False)))
    lines = {
        str(scenario): ([*dict.fromkeys(of["rail"])], [*dict.fromkeys(of["identifier"])])
        for scenario, of in peaks.groupby("scenario", sort=False)
    }
    # In inches: margins about the panels, a panel, and what is between two.
    left, wide, between, below, row = 1.6, 3.0, 0.15, 1.05, 0.34
    columns = max(len(rails) for rails, _ in lines.values())
    entries = min(columns, 3)  # of the legend side by side
    width = left + columns * (wide + between)
    heights = [row * max(len(names), 4) for _, names in lines.values()]
    height = sum(heights) + below * len(lines) + 0.8 - 0.1 * entries
    figure = Figure(figsize=(width, height), dpi=_FEW_PANELS)
    above = 0.5
    for tall, (scenario, (rails, names)) in zip(heights, lines.items(), strict=True):
        bottom = height - above - tall
        for column, rail in enumerate(rails):
            start = left + column * (wide + between)
            size = wide / width, tall / height
            axis = figure.add_axes((start / width, bottom / height, *size))
            told = peaks[(peaks["scenario"] == scenario) & (peaks["rail"] == rail)].iloc[0]
            of_names = {name: drawn[scenario, rail, name] for name in names}
            high = _rows(axis, of_names, float(told["truth"]), float(told["crlb"]))
            axis.tick_params("y", labelleft=column == 0, labelsize=9)
            where = f"{scenario}, {rail} rail" if len(lines) > 1 else f"{rail} rail"
            axis.set_title(f"{where}\na row is as high as a density of {high:.0f}", fontsize=9)
        above += tall + below
    one_legend(figure, figure.axes[:1], ncols=entries)
    return figure


def _rows(axis: Axes, densities: Mapping[str, pd.DataFrame], truth: float, bound: float) -> float:
    """The density of each method above a line of its own, and the height of a row."""
    (low, *_), (*_, high) = (next(iter(densities.values()))[end] for end in ("lower", "upper"))
    x = np.linspace(low, high, 200)
    sd = bound if bound > 0 else np.nan
    best = np.exp(-(((x - truth) / sd) ** 2) / 2) / (sd * np.sqrt(2 * np.pi))
    every = np.concatenate([best, *(bins["density"] for bins in densities.values())])
    top = 1.1 * float(np.nanmax(every)) or 1.0
    for place, bins in enumerate(densities.values()):
        edges = np.append(bins["lower"], bins["upper"].iloc[-1])
        axis.stairs(
            bins["density"] / top - place,
            edges,
            baseline=-place,
            fill=True,
            color="0.75",
            label="probability density of the estimates",
        )
        axis.plot(x, best / top - place, "k--", linewidth=0.8, label=_BEST)
        outside = 1 - float((bins["density"] * np.diff(edges)).sum())
        if outside > _NONE_OUTSIDE:
            beyond = f"{100 * outside:.3g} % beyond"
            axis.text(high - 0.01 * (high - low), 0.5 - place, beyond, ha="right", fontsize=7)
    axis.axvline(truth, color="k", linewidth=0.8, label="truth")
    axis.set(xlim=(low, high), ylim=(1 - len(densities), 1), xlabel=LABELS["mu_max"])
    axis.set_yticks(-np.arange(len(densities)), densities)
    axis.xaxis.set_major_locator(MaxNLocator(4))
    return top


def tracking(truth: pd.DataFrame, bands: pd.DataFrame) -> Figure:
    """Parameters and mu_max over the blocks: the median and the band from 5 to 95 %.

    One row per quantity, the last one for the error of mu_max; one column per identifier. `truth`
    has the columns block and quantities.
    """
    names, shown = list(dict.fromkeys(bands["identifier"])), _shown(truth)
    labels = [*map(_label, shown), r"error of $\mu_{max}$ (%)"]
    figure, axes = _grid(names, labels, "block (1)")
    # The beginning and the end of each block, so that a single block is visible as well.
    block = np.repeat(truth["block"], 2) + np.tile([-0.5, 0.5], len(truth))
    for name, column in zip(names, axes.T, strict=True):
        for quantity, axis in zip(shown, column[:-1], strict=True):
            true = np.repeat(truth[quantity].to_numpy(), 2)
            _band(axis, block, _of(bands, name, quantity, 2), true)
        error = _of(bands, name, "mu_max", 2) / np.repeat(truth["mu_max"].to_numpy(), 2) - 1
        _band(column[-1], block, 100 * error)
        column[-1].axhline(0, color="k", linestyle="--", linewidth=1)
        column[-1].xaxis.set_major_locator(MaxNLocator(integer=True))
    axes[0, 0].legend(fontsize=7, loc="upper right")
    return figure


def _of(bands: pd.DataFrame, name: str, quantity: str, times: int = 1) -> NDArray[np.float64]:
    """The lower end, the median and the upper end of the bands of a method after each block."""
    rows = bands[(bands["identifier"] == name) & (bands["quantity"] == quantity)]
    return np.repeat(rows[["p05", "median", "p95"]].to_numpy().T, times, axis=1)


def _band(
    axis: Axes,
    place: ArrayLike,
    band: NDArray[np.float64],
    truth: NDArray[np.float64] | None = None,
    **how: Any,
) -> None:
    low, middle, high = band
    axis.fill_between(place, low, high, color="0.75", label="5 to 95 %")
    axis.plot(place, middle, color="#0072B2", linewidth=1.2, label="median")
    if truth is not None:
        axis.plot(place, truth, "k--", linewidth=1, label="truth", **how)


def _label(quantity: str) -> str:
    return _SHORT.get(quantity, LABELS.get(quantity, quantity))


def _shown(truth: pd.DataFrame) -> list[str]:
    return [str(name) for name in truth if name not in ("block", "slip_opt")]


def bands(truth: pd.DataFrame, bands: pd.DataFrame, step: int) -> Figure:
    """The quantities of a stream over its samples, and the forgetting factor beneath them.

    One column per identifier, so that the two algorithms of Qian et al. 2024 stand side by side
    (their Fig. 4 to 6); one row per quantity: the median and the band from 5 to 95 % of the runs.
    `truth` has the columns block and quantities, a block is `step` samples.
    """
    names, shown = list(dict.fromkeys(bands["identifier"])), _shown(truth)
    rows = [*shown, "forgetting"]
    figure, axes = _grid(names, [*map(_label, rows)], "samples (1)")
    seen = step * (truth["block"].to_numpy() + 1)
    for name, column in zip(names, axes.T, strict=True):
        for quantity, axis in zip(rows, column, strict=True):
            true = truth[quantity].to_numpy() if quantity in shown else None
            _band(axis, seen, _of(bands, name, quantity), true, drawstyle="steps")
            if true is not None:
                reach = 0.6 * max(np.abs(true).max(), np.ptp(true))
                axis.set_ylim(min(true.min(), 0) - reach / 4, true.max() + reach)
        column[-1].set_ylim(-0.05, 1.05)
    axes[0, 0].legend(fontsize=7, loc="upper right")
    return figure


def _grid(
    names: Sequence[str], labels: Sequence[str], under: str
) -> tuple[Figure, NDArray[np.object_]]:
    """Panels with a column for each name and a row for each label.

    Margins are set in inches: a layout engine takes longer than drawing.
    """
    width, height = 2.4 * len(names) + 1.2, 2.0 * len(labels)
    figure = Figure(figsize=(width, height), dpi=_MANY_PANELS)
    margins = {"left": 0.8 / width, "right": 1 - 0.1 / width}
    margins |= {"bottom": 0.5 / height, "top": 1 - 0.35 / height, "wspace": 0.06, "hspace": 0.08}
    axes: NDArray[np.object_] = figure.subplots(
        len(labels), len(names), sharex=True, sharey="row", squeeze=False, gridspec_kw=margins
    )
    for name, column in zip(names, axes.T, strict=True):
        column[0].set_title(name, fontsize=10)
        column[-1].set_xlabel(under)
    for label, axis in zip(labels, axes[:, 0], strict=True):
        axis.set_ylabel(label)
    return figure, axes


def convergence(
    checkpoints: pd.DataFrame,
    bands: pd.DataFrame,
    reached_label: str,
    reached: Sequence[float],
) -> Figure:
    """Estimates against the part of a run that has been seen (He et al. 2018, Fig. 4 to 7).

    For every identifier the median and the band from 5 to 95 %, one panel a quantity; the grey
    band is the truth with the Cramer-Rao bound's 90 % width.
    """
    shown = list(dict.fromkeys(checkpoints["quantity"]))[:4]
    names = list(dict.fromkeys(checkpoints["identifier"]))
    styles = line_styles(names)
    figure = Figure(figsize=(11, 8), dpi=_FEW_PANELS, layout="constrained")
    every = figure.subplots(2, 2).ravel()
    axes = every[: len(shown)]
    for axis in every[len(shown) :]:
        axis.remove()
    seen = np.array(reached)
    step = 0.1 * np.min(np.diff(seen, prepend=0.0))
    for name in names:
        for quantity, axis in zip(shown, axes, strict=True):
            low, middle, high = _of(bands, name, quantity)
            spread = np.array([middle - low, high - middle])
            shift = (names.index(name) - (len(names) - 1) / 2) * step
            axis.errorbar(
                seen + shift,
                middle,
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
            seen,
            truth - 1.645 * bound,
            truth + 1.645 * bound,
            color="0.88",
            zorder=0,
            label="truth ± 1.645 × Cramér-Rao bound",
        )
        axis.axhline(truth[0], color="0.4", linewidth=1)
        known = bound[np.isfinite(bound)]
        if known.size:
            centre, reach = truth[0], 8 * np.median(known)
            axis.set_ylim(centre - reach, centre + reach)
        axis.set(xlabel=reached_label, ylabel=LABELS.get(quantity, quantity))
    one_legend(figure, axes[:1], **_LEGEND)
    return figure


def drift(checkpoints: pd.DataFrame) -> Figure:
    """How well mu_max is known on a rail that drifts, over the samples: RMSE, bias and coverage."""
    rows = checkpoints[checkpoints["quantity"] == "mu_max"]
    names = list(dict.fromkeys(rows["identifier"]))
    styles = line_styles(names)
    figure = Figure(figsize=(8, 9), dpi=_FEW_PANELS, layout="constrained")
    error, bias, coverage = axes = figure.subplots(3, 1, sharex=True)
    for name in names:
        own = rows[rows["identifier"] == name]
        style = {**styles[name], "markersize": 3, "linewidth": 1}
        percent = 100 / own["truth"]
        error.semilogy(own["k"], percent * own["rmse"], label=name, **style)
        bias.errorbar(own["k"], percent * own["bias"], 1.96 * percent * own["bias_se"], **style)
        shares = own["coverage95"], 1.96 * own["coverage95_se"]
        coverage.errorbar(own["k"], *shares, **style)
    error.semilogy(own["k"], percent * own["crlb"], "0.6", linewidth=4, label="bound", zorder=0)
    for axis, level in ((bias, 0.0), (coverage, 0.95)):
        axis.axhline(level, color="0.6", linewidth=3, zorder=0)
    bias.set_yscale("symlog", linthresh=1.0)
    error.set_ylabel(r"RMSE of $\mu_{max}$ (%)")
    bias.set_ylabel(r"bias of $\mu_{max}$ (%)")
    coverage.set(ylabel="coverage of 95 % intervals (1)", xlabel="samples (1)", ylim=(-0.05, 1.05))
    one_legend(figure, axes[:1], **_LEGEND)
    return figure
