"""Figures of a Monte Carlo campaign, drawn from its tables."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

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

#: A share below this is rounding.
_NONE_OUTSIDE = 1e-9


def histogram(summary: pd.DataFrame, densities: pd.DataFrame) -> Figure:
    """mu_max of every identifier with truth and bound, one panel per scenario and rail.

    `densities` has a row for each scenario, rail, identifier and bin (lower, upper, density). The
    share of estimates beyond the axis is written in the panel. After He et al. 2018, Fig. 12, 17.
    """
    rows = summary[summary["quantity"] == "mu_max"]
    panels = list(dict.fromkeys(zip(rows["scenario"], rows["rail"], strict=True)))
    names = list(dict.fromkeys(rows["identifier"]))
    several = len({scenario for scenario, _ in panels}) > 1
    styles = line_styles(names)
    columns = min(len(panels), 3)
    lines = -(-len(panels) // columns)
    size = (5.2 * max(columns, 1.4), 4.2 * lines + 1.0)
    figure = Figure(figsize=size, dpi=_FEW_PANELS, layout="constrained")
    axes = figure.subplots(lines, columns, squeeze=False).ravel()
    for axis in axes[len(panels) :]:
        axis.set_axis_off()
    truth = rows.groupby(["scenario", "rail"])["truth"].first()
    bound = rows.groupby(["scenario", "rail"])["crlb"].first()
    beyond: dict[tuple[str, str], list[str]] = {panel: [] for panel in panels}
    drawn = densities.groupby(["scenario", "rail", "identifier"], sort=False)
    for key, bins in drawn:
        scenario, rail, name = map(str, key)
        axis = axes[panels.index((scenario, rail))]
        edges = np.append(bins["lower"].to_numpy(), bins["upper"].iloc[-1])
        outside = 1 - float((bins["density"] * (bins["upper"] - bins["lower"])).sum())
        if outside > _NONE_OUTSIDE:
            beyond[scenario, rail].append(f"{name}: {100 * outside:.3g} %")
        style = {part: styles[name][part] for part in ("color", "linestyle")}
        axis.stairs(bins["density"], edges, label=name, linewidth=1.3, **style)
    for panel, axis in zip(panels, axes, strict=False):
        centre, width = truth[panel], bound[panel]
        axis.axvline(centre, color="0.4", linewidth=1, label="truth")
        if np.isfinite(width):
            band = (centre - 1.96 * width, centre + 1.96 * width)
            axis.axvspan(*band, color="0.9", zorder=0, label="truth ± 1.96 × Cramér-Rao bound")
        title = f"{panel[0]}: {panel[1]} rail" if several else f"{panel[1]} rail"
        axis.set(title=title, xlabel=LABELS["mu_max"], ylabel="probability density (1)")
        if beyond[panel]:
            note = "\n".join(["beyond the axis", *beyond[panel]])
            axis.text(0.02, 0.98, note, transform=axis.transAxes, va="top", fontsize=7)
    one_legend(figure, axes, **_LEGEND)
    return figure


def tracking(truth: pd.DataFrame, bands: pd.DataFrame) -> Figure:
    """Parameters and mu_max over the blocks: the median and the band from 5 to 95 %.

    One row per quantity, the last one for the error of mu_max; one column per identifier. `truth`
    has the columns block and quantities.
    """
    names, shown = list(dict.fromkeys(bands["identifier"])), _shown(truth)
    labels = [*map(_label, shown), r"error of $\mu_{max}$ (%)"]
    figure, axes = _grid(names, labels, "block (1)")
    block, peak = truth["block"].to_numpy(), truth["mu_max"].to_numpy()
    for name, column in zip(names, axes.T, strict=True):
        for quantity, axis in zip(shown, column[:-1], strict=True):
            _band(axis, block, *_of(bands, name, quantity))
            true = np.repeat(truth[quantity].to_numpy(), 2)
            axis.plot(_edges(block), true, "k--", linewidth=1, label="truth")
        error = (100 * (part / peak - 1) for part in _of(bands, name, "mu_max"))
        _band(column[-1], block, *error)
        column[-1].axhline(0, color="k", linestyle="--", linewidth=1)
        column[-1].xaxis.set_major_locator(MaxNLocator(integer=True))
    axes[0, 0].legend(fontsize=7, loc="upper right")
    return figure


def _of(bands: pd.DataFrame, name: str, quantity: str) -> list[np.ndarray]:
    """The lower end, the median and the upper end of the bands of a method after each block."""
    rows = bands[(bands["identifier"] == name) & (bands["quantity"] == quantity)]
    return [rows[column].to_numpy() for column in ("p05", "median", "p95")]


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
            low, middle, high = _of(bands, name, quantity)
            axis.fill_between(seen, low, high, color="0.75", label="5 to 95 %")
            axis.plot(seen, middle, color="#0072B2", linewidth=1.2, label="median")
            if quantity in shown:
                true = truth[quantity].to_numpy()
                axis.plot(seen, true, "k--", linewidth=1, label="truth", drawstyle="steps")
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
    axes = figure.subplots(2, 2).ravel()
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
        centre, reach = truth[0], 8 * np.median(bound)
        axis.set_ylim(centre - reach, centre + reach)
        axis.set(xlabel=reached_label, ylabel=LABELS[quantity])
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


def _band(
    axis: Axes, block: np.ndarray, low: np.ndarray, middle: np.ndarray, high: np.ndarray
) -> None:
    x, low, middle, high = _edges(block), *(np.repeat(part, 2) for part in (low, middle, high))
    axis.fill_between(x, low, high, color="0.75", label="5 to 95 %")
    axis.plot(x, middle, color="#0072B2", linewidth=1.2, label="median")


def _edges(block: np.ndarray) -> np.ndarray:
    """The beginning and the end of each block, so that a single block is visible as well."""
    return np.ravel(np.column_stack([block - 0.5, block + 0.5]))
