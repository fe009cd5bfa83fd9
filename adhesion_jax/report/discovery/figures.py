"""The figures of a discovery: the law over the data, errors, corrections and the ranking."""

import warnings
from collections.abc import Mapping
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from adhesion_jax.curves import adhesion_of
from adhesion_jax.discovery.types import Candidate, Dependence, Findings, Interval
from adhesion_jax.report.discovery.residuals import level_panels, residual_panels
from adhesion_jax.report.discovery.tables import ranking, shape_columns
from adhesion_jax.report.discovery.words import (
    beside_median,
    column_label,
    decision,
    error,
    errors_by_data,
    humanised,
    kind_of_run,
    number,
)
from adhesion_jax.report.style import (
    AFTER,
    BEFORE,
    MARKS,
    POINT,
    STRETCHED,
    Shown,
    label_text,
    light_frame,
    one_legend,
    panels,
    slip_axis,
    thinned,
)

_DPI = 110

#: Largest number of bars of a round; the other candidates are in the table.
_BARS = 10
_ROUNDS = 4

#: Longest decision, in letters.
_WORDS = 60

#: A panel has a scale of its own if its factor ranges over more than this many times the median
#: range of all panels, or over more than this where that is below 1.
_APART = 4.0


def draw_discovery(folder: Path, findings: Findings) -> None:
    """Every figure that applies, as PNG."""
    figures = {
        "adhesion.png": adhesion_over_slip(findings),
        "residuals.png": residual_panels(findings),
        "levels.png": level_panels(findings),
        "dependence.png": _dependences(findings),
        "shapes.png": shape_panels(findings),
        "errors.png": _errors(findings),
        "ranking.png": _ranking(findings),
    }
    with warnings.catch_warnings():
        # A name in a script the font lacks shows as boxes; that is no reason to warn a user.
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        for name, figure in figures.items():
            if figure is not None:
                figure.savefig(folder / name, dpi=_DPI)


def adhesion_over_slip(findings: Findings) -> Figure:
    """The points, and the law before and after at the median of every column."""
    points = thinned(findings.points)
    low, high = slip_limits(findings)
    figure = Shown(figsize=(8.5, 5.0), layout="constrained")
    axis = figure.subplots()
    axis.scatter(
        points["slip"],
        points["adhesion"],
        s=9,
        facecolors="none",
        edgecolors=POINT,
        linewidths=0.7,
        alpha=0.55,
        rasterized=True,
        label="measured",
    )
    grid = law_grid(findings)
    marks = MARKS if grid.size == 1 else {"before": {"color": BEFORE}, "after": {"color": AFTER}}
    conditions = medians(findings)
    before = np.asarray(adhesion_of(findings.law_before, grid, conditions))
    names = {when: f"law {when} (median conditions)" for when in marks}
    axis.plot(grid, before, linestyle=(0, (5, 2)), label=names["before"], **marks["before"])
    after = np.asarray(adhesion_of(findings.law, grid, conditions))
    axis.plot(grid, after, linewidth=2.2, label=names["after"], **marks["after"])
    slip_axis(axis, low, high)
    axis.set(
        xlim=(low, high),
        xlabel=f"{column_label(findings.slip)}, {STRETCHED}",
        ylabel="adhesion, tangential force / normal load (1)",
    )
    light_frame(axis)
    figure.legend(loc="outside lower center", ncols=3, frameon=False)
    return figure


def _dependences(findings: Findings) -> Figure | None:
    if not findings.dependences:
        return None
    factors = [np.append(one.factor, 1.0) for one in findings.dependences]
    ranges = [np.ptp(one) for one in factors]
    usual = max(np.median(ranges), 1.0)
    apart = [place for place, one in enumerate(ranges) if one > _APART * usual]
    figure, axes = panels(len(factors), 2.2, "factor on adhesion (1)", apart)
    for axis, dependence in zip(axes, findings.dependences, strict=True):
        _dependence(axis, dependence, findings)
    # A band that the data hardly bound would hide every curve.
    alike = [place for place in range(len(ranges)) if place not in apart]
    for places in (alike, *([place] for place in apart)):
        whole = np.concatenate([factors[place] for place in places])
        ends = np.array([whole.min(), whole.max()]) + np.ptp(whole) * np.array([-1.0, 1.0])
        if np.ptp(whole) > 0:
            axis = axes[places[0]]
            axis.set_ylim(np.clip(ends, *axis.get_ylim()))
    curves = [axis for axis, one in zip(axes, findings.dependences, strict=True) if not one.labels]
    one_legend(figure, curves[:1])
    return figure


def _dependence(axis: Axes, dependence: Dependence, findings: Findings) -> None:
    axis.axhline(1.0, color="0.4", linewidth=0.8)
    named, at_slip = label_text(humanised(dependence.effect)), dependence.at_slip
    held = label_text(beside_median(findings, dependence))
    if np.isfinite(at_slip) and dependence.column != "slip_ratio":
        said = f"at slip {at_slip:.2g}"
        named, held = (named, f"{said}, {held}") if held else (f"{named}, {said}", "")
    axis.set_title("\n".join(filter(None, (named, held))), fontsize=9, loc="left")
    if dependence.labels:
        middle, places = dependence.factor, np.arange(len(dependence.labels))
        spread = np.maximum([middle - dependence.low, dependence.high - middle], 0.0)
        axis.errorbar(places, middle, yerr=spread, linestyle="none", capsize=3, **MARKS["after"])
        axis.set_xticks(places, [label_text(name, 12) for name in dependence.labels])
        axis.set_xlabel(label_text(column_label(dependence.column)))
        return
    values = dependence.values
    axis.fill_between(
        values, dependence.low, dependence.high, color="0.82", linewidth=0, label="95 % band"
    )
    axis.plot(values, dependence.factor, color=AFTER, linewidth=2, label="factor on adhesion")
    if dependence.column in findings.points:
        measured = findings.points[dependence.column].to_numpy(dtype=float)
        tenths = np.quantile(measured, np.linspace(0, 1, 11))
        axis.plot(
            tenths,
            np.zeros_like(tenths),
            "|",
            color="0.3",
            markersize=9,
            transform=axis.get_xaxis_transform(),
            clip_on=False,
            label="deciles of the points",
        )
    axis.set_xlabel(label_text(column_label(dependence.column, dependence.unit)))
    axis.xaxis.set_major_locator(MaxNLocator(5))


def _errors(findings: Findings) -> Figure:
    rows = errors_by_data(findings)
    figure = Figure(figsize=(8.5, 1.3 + 0.62 * len(rows)), layout="constrained")
    axis = figure.subplots()
    for when in ("before", "after"):
        intervals: list[Interval] = [getattr(errors, when) for errors in rows.values()]
        value, low, high = np.array(intervals, dtype=float).T
        axis.errorbar(
            value,
            np.arange(len(rows)) + (-0.13 if when == "before" else 0.13),
            xerr=np.nan_to_num([np.maximum(value - low, 0), np.maximum(high - value, 0)]),
            linestyle="none",
            capsize=3,
            label=when,
            **MARKS[when],
        )
    axis.axvline(
        findings.noise_floor,
        color="0.25",
        linestyle=(0, (4, 2)),
        linewidth=1,
        label=f"noise floor {error(findings.noise_floor)}",
    )
    # Otherwise it may lie on the frame.
    axis.update_datalim([(findings.noise_floor, 0.0)], updatey=False)
    axis.autoscale_view()
    kind = kind_of_run(findings)
    names = [
        f"{name} ({errors.runs} {kind}{'s' if errors.runs > 1 else ''})"
        for name, errors in rows.items()
    ]
    axis.set_yticks(np.arange(len(rows)), names)
    axis.set(xlabel="root mean square error of adhesion (1)", ylim=(len(rows) - 0.5, -0.5))
    light_frame(axis)
    figure.legend(loc="outside lower center", ncols=3, frameon=False)
    return figure


def _ranking(findings: Findings) -> Figure | None:
    rounds = [list(rows) for _, rows in groupby(ranking(findings), lambda row: row.round)]
    rounds = [rows[:_BARS] for rows in rounds[:_ROUNDS]]
    if not rounds:
        return None
    bars = [len(rows) for rows in rounds]
    figure = Figure(figsize=(8.5, 0.9 + 0.27 * sum(bars) + 0.45 * len(bars)), layout="constrained")
    axes = figure.subplots(
        len(rounds), 1, sharex=True, squeeze=False, height_ratios=[count + 1 for count in bars]
    ).ravel()
    end = max(_end(row) for rows in rounds for row in rows)
    # Forms for the columns that boosted trees need are sought last, in a round without a threshold.
    by_trees = any(effect.by_trees for effect in (*findings.effects, *findings.unexplained))
    for axis, rows in zip(axes, rounds, strict=True):
        of_trees = by_trees and rows[0].round >= len(findings.thresholds)
        _round(axis, rows, findings.thresholds, of_trees)
        axis.set_xlim(0.0, end)
    axes[-1].set_xlabel("z of the score test (1)")
    with_lines = [axis for axis in axes if axis.get_legend_handles_labels()[0]]
    if with_lines:
        figure.legend(
            *with_lines[0].get_legend_handles_labels(),
            loc="outside lower center",
            fontsize=8,
            frameon=False,
        )
    return figure


def _end(row: Candidate) -> float:
    """The end of the axis at which a bar and the words beside it fit."""
    words = min(len(decision(row.decision)), _WORDS)
    return max(float(np.nan_to_num(row.z)), 1.0) / (0.94 - 0.0085 * words)


def _round(
    axis: Axes, rows: list[Candidate], thresholds: tuple[float, ...], of_trees: bool
) -> None:
    bars = axis.barh(
        np.arange(len(rows)),
        # A negative z is drawn as 0: a bar to the left would run into the names.
        np.maximum(np.nan_to_num([row.z for row in rows]), 0.0),
        color=[_shade(row.decision) for row in rows],
        edgecolor="0.25",
        linewidth=0.6,
    )
    names = [label_text(humanised(row.name), 64) for row in rows]
    axis.set_yticks(np.arange(len(rows)), names, fontsize=8)
    words = [label_text(decision(row.decision), _WORDS) for row in rows]
    behind = {"facecolor": "white", "edgecolor": "none", "pad": 1.0}
    axis.bar_label(bars, words, padding=5, fontsize=8, bbox=behind)
    threshold = dict(enumerate(thresholds)).get(rows[0].round, np.nan)
    if np.isfinite(threshold):
        dashed = (0, (4, 2))
        axis.axvline(threshold, color="0.25", linestyle=dashed, linewidth=1, zorder=1.5)
        axis.plot([], [], color="0.25", linestyle=dashed, linewidth=1, label="significant beyond")
    axis.set_ylim(len(rows) - 0.4, -0.6)
    whose = ", of columns that boosted trees need: accepted by the p of the trees" * of_trees
    axis.set_title(f"round {rows[0].round + 1}{whose}", fontsize=9, loc="left")
    light_frame(axis)


def _shade(decision: str) -> str:
    if decision.startswith("accepted"):
        return "#08306b"
    return "0.6" if decision.startswith("in the class") else "0.92"


#: Shares of the points below the values that are drawn, and their lines.
_QUANTILES: Mapping[float, Mapping[str, Any]] = {
    0.05: {"color": "#56B4E9", "linestyle": (0, (5, 2))},
    0.5: {"color": AFTER, "linestyle": "-"},
    0.95: {"color": "#D55E00", "linestyle": (0, (5, 1, 1, 1))},
}

#: The slip counts as one value if it varies by less than this share of its size.
_ONE_SLIP = 1e-6

#: A side of zero is reached if its largest slip exceeds this share of that of the other side.
_REACHED = 0.05


def shape_panels(findings: Findings) -> Figure | None:
    """A panel for each effect and column, other columns at their medians; None without effects."""
    shown = shape_columns(findings)
    if not shown:
        return None
    low, high = slip_limits(findings)
    grid = law_grid(findings)
    conditions = medians(findings)
    figure, axes = panels(len(shown), 2.6, "adhesion (1)")
    for axis, (effect, name) in zip(axes, shown, strict=True):
        # Zipped: a column may have fewer labels than there are lines.
        for (value, label), style in zip(_drawn(findings, name), _QUANTILES.values(), strict=False):
            adhesion = adhesion_of(findings.law, grid, {**conditions, name: value})
            axis.plot(grid, adhesion, label=label_text(label), **style)
        slip_axis(axis, low, high, gap=0.13)
        axis.set_xlim(low, high)
        axis.set_xlabel(f"{column_label(findings.slip)}, {STRETCHED}")
        axis.set_title(label_text(humanised(effect.name)), fontsize=9, loc="left")
        legend = axis.legend(fontsize=8, frameon=False, title=label_text(column_label(name), 34))
        legend.get_title().set_fontsize(8)
    return figure


def _drawn(findings: Findings, name: str) -> list[tuple[float, str]]:
    """The values of a column that are drawn, and what they are called: quantiles, or labels.

    Labels have no order: of them the ones that most points have.
    """
    column = findings.points[name]
    if name in findings.named:
        codes = sorted(column.value_counts().index[: len(_QUANTILES)])
        return [(float(code), findings.named[name][int(code)]) for code in codes]
    values = {share: float(column.quantile(share, interpolation="nearest")) for share in _QUANTILES}
    return [(value, f"{number(value)} ({100 * share:.0f} %)") for share, value in values.items()]


def slip_limits(findings: Findings) -> tuple[float, float]:
    """The ends of the slip axis: zero and a little more than the measured slips."""
    slip = findings.points["slip"].to_numpy(dtype=float)
    low, high = min(0.0, 1.04 * slip.min()), max(0.0, 1.04 * slip.max())
    return (low, high) if low < high else (low, 1.0)  # every slip may be zero


def law_grid(findings: Findings) -> np.ndarray:
    """The slips at which laws are drawn, in equal steps of their roots, [301].

    On both sides of zero only where both are reached: noise of the slip makes some of either sign.
    Where all slips are one, that one, [1]: of the curve about it nothing was measured.
    """
    slip = findings.points["slip"].to_numpy(dtype=float)
    if np.ptp(slip) <= _ONE_SLIP * np.abs(slip).max():
        return slip[:1]
    low, high = slip_limits(findings)
    low, high = (low if -low > _REACHED * high else 0.0), (high if high > -_REACHED * low else 0.0)
    root = np.linspace(-np.sqrt(-low), np.sqrt(high), 301)
    return np.sign(root) * root**2


def medians(findings: Findings) -> Mapping[str, float]:
    """The median of every column, so that the law is drawn in its steady state.

    It is one of the values, since labels have none between them.
    """
    numeric = findings.points.select_dtypes("number").drop(
        columns=["run", "slip", "adhesion", "before", "after"], errors="ignore"
    )
    calendar = findings.law.calendar
    middle = {calendar.column: float(calendar.start + calendar.end) / 2}
    typical = numeric.quantile(interpolation="nearest")
    return {**middle, **{str(name): float(value) for name, value in typical.items()}}
