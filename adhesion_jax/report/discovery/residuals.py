"""The residual of a law, and the levels of the runs, before and after, against every column."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from adhesion_jax.discovery.types import Findings
from adhesion_jax.report.discovery.tables import level_columns, residual_columns
from adhesion_jax.report.discovery.words import column_label
from adhesion_jax.report.style import (
    MARKS,
    POINT,
    label_text,
    one_legend,
    panels,
    slip_axis,
    thinned,
)

#: Number of bins in which the means of a column are drawn.
_BINS = 10

#: Fewest bins of a column that is nearly constant in each run.
_FEWEST_BINS = 3

#: Fewest runs in a bin for a useful standard error.
_RUNS_A_BIN = 4

#: Half the height of a panel, in standard deviations of its points: the panel shows the means.
_REACH = 2.2


def residual_panels(findings: Findings) -> Figure | None:
    """Small multiples: points before, and the means in bins before and after; none to draw: None.

    Means and their errors are taken over runs, because the points of a run are not independent.
    """
    names, _ = residual_columns(findings)
    if not names:
        return None
    figure, axes = panels(len(names), 1.75, "measured less law (1)")
    points = findings.points
    # Turned by the sign of the slip: what lowers adhesion would else part traction and braking.
    sign = 1.0 - 2.0 * (points["slip"] < 0)
    left = {when: sign * (points["adhesion"] - points[when]) for when in ("before", "after")}
    reach = _REACH * float(np.sqrt(np.mean(left["before"] ** 2)))
    for axis, name in zip(axes, names, strict=True):
        place = points[name].astype(float)
        axis.axhline(0.0, color="0.4", linewidth=0.8)
        drawn = thinned(pd.DataFrame({"place": place, "left": left["before"]}))
        axis.plot(
            drawn["place"],
            drawn["left"],
            ".",
            color=POINT,
            markersize=2.5,
            alpha=0.35,
            markeredgewidth=0,
            rasterized=True,
        )
        for when in ("before", "after"):
            means = _binned(place, left[when], points["run"])
            reach = max(reach, _draw(axis, means, when))
        axis.set_xlabel(_label(findings, name))
        if name == "slip":
            low, high = min(0.0, 1.04 * place.min()), max(0.0, 1.04 * place.max())
            slip_axis(axis, low, high, gap=0.13)
            axis.set_xlim(low, high)
        else:
            _ticks(axis, findings.named.get(name, ()))
    # An empty line, for the points are too small for a legend.
    axes[0].plot([], [], ".", color=POINT, markersize=6, label="points before")
    axes[0].set_ylim(-reach, reach)  # the panels share it
    one_legend(figure, axes[:1])
    return figure


def _label(findings: Findings, name: str) -> str:
    return label_text(column_label(findings.slip if name == "slip" else name), 40)


def _ticks(axis: Axes, labels: Sequence[str]) -> None:
    """Few numbers, or the labels at the places 0, 1 ... of a column that has some."""
    if not labels:
        axis.xaxis.set_major_locator(MaxNLocator(4))
        return
    axis.set_xticks(np.arange(len(labels)), [label_text(label, 10) for label in labels])
    axis.set_xlim(-0.5, len(labels) - 0.5)


def _binned(place: pd.Series, left: pd.Series, run: pd.Series) -> pd.DataFrame:
    """For each bin: mean over runs, its standard error, and the place on the axis."""
    if place.nunique() <= _BINS:
        bins = place.rank(method="dense")
    else:
        count, along = _BINS, place.groupby(run).std().median()
        if along < 0.1 * place.std():  # it is nearly constant in each run
            count = int(np.clip(run.nunique() // _RUNS_A_BIN, _FEWEST_BINS, _BINS))
        edges = np.unique(np.quantile(place, np.linspace(0, 1, count + 1)))
        bins = pd.Series(np.digitize(place, edges[1:-1]), index=place.index)
    table = pd.DataFrame({"place": place, "left": left, "bin": bins, "run": run})
    of_runs = table.groupby(["bin", "run"], observed=True)[["place", "left"]].mean()
    by_bin = of_runs.groupby("bin")
    return pd.DataFrame(
        {
            "place": by_bin["place"].mean(),
            "mean": by_bin["left"].mean(),
            "error": by_bin["left"].sem().fillna(0.0),
        }
    )


def _draw(axis: Axes, means: pd.DataFrame, when: str) -> float:
    """Draws the means with their errors; returns the largest distance from zero."""
    before = when == "before"
    axis.errorbar(
        means["place"],
        means["mean"],
        2 * means["error"],
        linestyle=(0, (3, 2)) if before else "-",
        linewidth=1,
        markersize=4.5 if before else 4,
        capsize=2,
        zorder=4 if before else 5,
        label=f"mean {when}, ± 2 standard errors",
        **MARKS[when],
    )
    return float(1.15 * np.max(np.abs(means["mean"]) + 2 * means["error"]))


def level_panels(findings: Findings) -> Figure | None:
    """A panel for each column, a point for each run; None where no column differs between runs."""
    names, _ = level_columns(findings)
    levels = findings.levels
    if levels is None or not names:
        return None
    figure, axes = panels(len(names), 1.9, "measured less law\n(% of the law)")
    for axis, name in zip(axes, names, strict=True):
        axis.axhline(0.0, color="0.4", linewidth=0.8)
        for when in ("before", "after"):
            axis.errorbar(
                levels[name],
                100 * levels[when],
                200 * levels["error"],
                # A level that does not change shows as a point within a square.
                markersize=6 if when == "before" else 3.5,
                linestyle="none",
                elinewidth=0.8,
                label=f"run {when}, ± 2 standard errors",
                **MARKS[when],
            )
        axis.set_xlabel(_label(findings, name))
        _ticks(axis, findings.named.get(name, ()))
    one_legend(figure, axes[:1])
    return figure
