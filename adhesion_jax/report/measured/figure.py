"""The figure of a measured record: points, curves with bands and peaks, residual."""

import textwrap
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from adhesion_jax.inference.fit import MeasuredFit
from adhesion_jax.measured.answer import band_of_answer
from adhesion_jax.measured.comparison import Comparison
from adhesion_jax.measured.residual import Residual, running_mean
from adhesion_jax.measured.vetoes import standing
from adhesion_jax.report.measured.words import Identified
from adhesion_jax.report.style import POINT, STRETCHED, Shown, light_frame, slip_axis

#: Colour, line and peak marker by rank: each alone tells the curves apart, in grey as well.
_STYLES = (
    ("#08306b", "-", "o"),
    ("#d95f02", (0, (6, 2)), "s"),
    ("#1b9e77", (0, (6, 2, 1, 2)), "^"),
    ("#7570b3", (0, (1, 1.2)), "D"),
    ("#e7298a", (0, (3, 1, 1, 1, 1, 1)), "v"),
    ("#8c6d1f", (0, (10, 3)), "P"),
)

#: The scale of slip is even where the largest tenth begins below this multiple of the end of the
#: smallest, and stretched near 0 otherwise.
_OF_ONE_SIZE = 5.0


def measured_figure(found: Identified) -> Figure:
    """The peak over the points with the curves and, below it, what each curve leaves."""
    ranked, best, left = found.ranked, found.fit, found.residuals[found.best]
    figure = Shown(figsize=(10, 8), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1))

    _points(above, left, left.adhesion)
    end, begin = 1.04 * left.slip[-1], min(1.04 * left.turned.min(), 0.0)
    grid = end * np.linspace(0.0, 1.0, 800) ** 2
    _answer(above, found, grid, left.slip)
    for rank, name in enumerate(ranked):
        _curve(above, name, found.fits[name], found.answer.weights[name], grid, rank)
    above.set_title(
        textwrap.fill(
            f"{found.title}: {best.points} points; the fitted curves and the peak with its 95 % "
            "interval",
            90,
        ),
        loc="left",
        parse_math=False,  # a file may have dollars in its name
    )
    above.set(
        ylabel="adhesion, tangential force / normal load (1)",
        xlim=(begin, end),
        ylim=(min(0.0, 1.1 * left.adhesion.min()), 1.1 * left.adhesion.max()),
    )
    low, high = np.quantile(left.slip, [0.1, 0.9])
    of_one_size = high < _OF_ONE_SIZE * low
    if not of_one_size:
        slip_axis(above, begin, end)  # the panels share it
    figure.legend(loc="outside lower center", ncols=2, fontsize=9, frameon=False)

    below.axhspan(-left.scatter, left.scatter, color="0.9", zorder=0)
    below.axhline(0.0, color="0.3", linewidth=0.8)
    _points(below, left, left.residual)
    window = max(5, left.slip.size // 12)
    for rank, name in enumerate(ranked):
        colour, line, _ = _STYLES[rank % len(_STYLES)]
        means = running_mean(found.residuals[name].slip, found.residuals[name].residual, window)
        below.plot(*means, color=colour, linestyle=line, linewidth=2.2 if rank == 0 else 1.4)
    below.set(
        xlabel=("slip velocity (m/s)" if best.slip_unit else "slip ratio (1)")
        + ("" if of_one_size else f", {STRETCHED}"),
        ylabel="measured less curve (1)",
        ylim=(-1.1 * np.abs(left.residual).max(), 1.1 * np.abs(left.residual).max()),
    )
    below.set_title(
        f"points: residual of {ranked[0]}; lines: running mean of {window} points, each curve; "
        "grey: scatter between neighbours",
        fontsize=9,
        loc="left",
    )
    for axes in (above, below):
        light_frame(axes)
    return figure


def _points(axes: Axes, left: Residual, height: np.ndarray) -> None:
    size, alpha = (16, 0.7) if left.slip.size < 1000 else (3, 0.25)
    for chosen, marker, label in ((~left.braking, "o", "traction"), (left.braking, "x", "braking")):
        if chosen.any():
            axes.scatter(
                left.turned[chosen],
                height[chosen],
                s=size,
                marker=marker,
                facecolors="none" if marker == "o" else POINT,
                edgecolors=POINT if marker == "o" else None,
                linewidths=0.8,
                alpha=alpha,
                label=f"measured, {label}" if left.braking.any() else "measured",
            )


def _answer(axes: Axes, found: Identified, grid: np.ndarray, measured_slip: np.ndarray) -> None:
    """The band of all curves together, and the peak with its intervals, or what is reached."""
    level, place = standing(found.answer, found.judgement)
    # Outside the measured slips the width of a band follows from the form of the curves alone.
    seen = grid[(grid >= measured_slip[0]) & (grid <= measured_slip[-1])][::8]
    if not found.answer.mu_max.value > 0:
        return
    _, low, high = band_of_answer(found.fits, found.answer, seen).T
    axes.fill_between(
        seen, low, high, color="#9ecae1", alpha=0.6, linewidth=0, label="all curves: 95 % band"
    )
    if np.isnan(level.value):
        return
    if np.isnan(place.value):
        axes.axhline(
            level.value, color="0.4", linestyle=(0, (6, 3)), label=f"at least {level.value:.4f}"
        )
        return
    axes.errorbar(
        place.value,
        level.value,
        xerr=[[place.value - place.low], [place.high - place.value]],
        yerr=[[level.value - level.low], [level.high - level.value]],
        color="black",
        marker="o",
        markersize=8,
        markeredgecolor="white",
        linewidth=1.8,
        capsize=4,
        zorder=50,
        linestyle="none",
        label=f"peak by all curves: {level.value:.4f} at {place.value:.3g}",
    )


def _curve(
    axes: Axes, name: str, fit: MeasuredFit, weight: float, grid: np.ndarray, rank: int
) -> None:
    """The curve with its departure, and its peak."""
    colour, line, marker = _STYLES[rank % len(_STYLES)]
    peak = float(fit.peak.slip) if fit.peak.found else grid[-1]
    slips = np.sort(np.append(grid, peak))
    told = f"peak at {peak:.3g}{fit.slip_unit}" if fit.peak.found else "no peak"
    axes.plot(
        slips,
        fit.law.at(slips).adhesion,
        color=colour,
        linestyle=line,
        linewidth=2.6 if rank == 0 else 1.5,
        zorder=20 - rank,
        marker=marker if fit.peak.found else "",
        markevery=[int(np.searchsorted(slips, peak))],
        markersize=7,
        markeredgecolor="white",
        label=f"{name}: weight {weight:.2f}, departure {100 * fit.misfit:.1f} %, {told}",
    )


def draw_comparison(path: Path, title: str, comparison: Comparison) -> None:
    """The largest adhesion of each group with its 95 % interval."""
    table = comparison.table
    places = np.arange(len(table))
    width = float(np.clip(1.5 + 0.4 * len(table), 7.0, 14.0))
    figure = Figure(figsize=(width, 4.5), layout="constrained")
    axes = figure.subplots()
    half = table["mu_max_hi"] - table["mu_max"]
    axes.errorbar(
        places,
        table["mu_max"],
        yerr=half,
        color=_STYLES[0][0],
        marker="o",
        linestyle="none",
        capsize=3,
        label="95 % interval",
    )
    mean = float(np.average(table["mu_max"], weights=table["runs"]))
    axes.axhline(mean, color="0.4", linestyle=(0, (6, 3)), label="mean over the runs")
    shown = places[:: -(-len(places) // 30)]
    names = [str(name) for name in table[comparison.by]]
    axes.set_xticks(
        shown, [names[i] if len(names[i]) <= 14 else f"{names[i][:13]}…" for i in shown]
    )
    axes.tick_params(axis="x", labelrotation=0 if len(places) <= 12 else 90)
    axes.set(xlabel=comparison.by, ylabel="largest adhesion, mu_max (1)")
    axes.set_title(
        f"{title}: {'a change' if comparison.changed else 'no change shown'} between the "
        f"{len(table)} groups by {comparison.by} (p = {comparison.p:.2g})",
        loc="left",
        fontsize=10,
        parse_math=False,
    )
    light_frame(axes)
    axes.legend(frameon=False)
    figure.savefig(path, dpi=150)
