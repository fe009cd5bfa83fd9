"""The figure of a measured record: points, curves with bands and peaks, residual."""

from collections.abc import Mapping
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from adhesion_jax.measured.fit import MeasuredFit, confidence_band
from adhesion_jax.measured.residual import Residual, running_mean
from adhesion_jax.report.style import root_axis

#: Colour, line and peak marker by rank: each alone tells the curves apart, in grey as well.
_STYLES = (
    ("#08306b", "-", "o"),
    ("#d95f02", (0, (6, 2)), "s"),
    ("#1b9e77", (0, (6, 2, 1, 2)), "^"),
    ("#7570b3", (0, (1, 1.2)), "D"),
    ("#e7298a", (0, (3, 1, 1, 1, 1, 1)), "v"),
    ("#8c6d1f", (0, (10, 3)), "P"),
)
_POINT = "#6b6b6b"


def draw_measured(
    path: Path, title: str, fits: Mapping[str, MeasuredFit], residuals: Mapping[str, Residual]
) -> None:
    """Adhesion and, below it, the residual of each curve against slip; the best curve first."""
    ranked = sorted(fits, key=lambda name: fits[name].bic)
    best, left = fits[ranked[0]], residuals[ranked[0]]
    figure = Figure(figsize=(10, 8), layout="constrained")
    FigureCanvasAgg(figure)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1))

    _points(above, left, left.adhesion)
    end = 1.04 * left.slip[-1]
    grid = end * np.linspace(0.0, 1.0, 800) ** 2
    for rank, name in enumerate(ranked):
        _curve(above, name, fits[name], best.bic, grid, left.slip, rank)
    above.set_title(
        f"{title}: {left.slip.size} points; curves with 95 % bands, peaks with 95 % intervals",
        loc="left",
        parse_math=False,  # a file may have dollars in its name
    )
    above.set(
        ylabel="adhesion, tangential force / normal load (1)",
        xlim=(0.0, end),
        ylim=(min(0.0, 1.1 * left.adhesion.min()), 1.1 * left.adhesion.max()),
    )
    root_axis(above, 0.0, end)  # the panels share it
    figure.legend(loc="outside lower center", ncols=2, fontsize=9, frameon=False)

    below.axhspan(-left.scatter, left.scatter, color="0.9", zorder=0)
    below.axhline(0.0, color="0.3", linewidth=0.8)
    _points(below, left, left.residual)
    window = max(5, left.slip.size // 12)
    for rank, name in enumerate(ranked):
        colour, line, _ = _STYLES[rank % len(_STYLES)]
        means = running_mean(residuals[name].slip, residuals[name].residual, window)
        below.plot(*means, color=colour, linestyle=line, linewidth=2.2 if rank == 0 else 1.4)
    below.set(
        xlabel=f"{'slip velocity (m/s)' if best.slip_unit else 'slip ratio (1)'}, root scale",
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
        axes.grid(color="0.9", linewidth=0.6)
        axes.set_axisbelow(True)
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=150)


def _points(axes: Axes, left: Residual, height: np.ndarray) -> None:
    size, alpha = (16, 0.7) if left.slip.size < 1000 else (3, 0.25)
    for chosen, marker, label in ((~left.braking, "o", "traction"), (left.braking, "x", "braking")):
        if chosen.any():
            axes.scatter(
                left.slip[chosen],
                height[chosen],
                s=size,
                marker=marker,
                facecolors="none" if marker == "o" else _POINT,
                edgecolors=_POINT if marker == "o" else None,
                linewidths=0.8,
                alpha=alpha,
                label=f"measured, {label}" if left.braking.any() else "measured",
            )


def _curve(
    axes: Axes,
    name: str,
    fit: MeasuredFit,
    least_bic: float,
    grid: np.ndarray,
    measured_slip: np.ndarray,
    rank: int,
) -> None:
    colour, line, marker = _STYLES[rank % len(_STYLES)]
    adhesion, half = confidence_band(fit, jnp.asarray(grid))
    # Outside the measured slips the width of a band follows from the form of the curve alone.
    seen = (grid >= measured_slip[0]) & (grid <= measured_slip[-1])
    axes.fill_between(
        grid, adhesion - half, adhesion + half, where=seen, color=colour, alpha=0.12, linewidth=0
    )
    width = 2.6 if rank == 0 else 1.5
    axes.plot(grid, adhesion, color=colour, linestyle=line, linewidth=width, zorder=20 - rank)
    label = f"{name}: rms {fit.rms:.4f}, difference of BIC {fit.bic - least_bic:+.1f}"
    slip_opt, mu_max = float(fit.peak.slip), float(fit.peak.adhesion)
    if fit.peak.found:
        label += f", peak at {slip_opt:.3g}{fit.slip_unit}"
        axes.errorbar(
            slip_opt,
            mu_max,
            xerr=fit.quantile * fit.slip_opt_se,
            yerr=fit.quantile * fit.mu_max_se,
            color=colour,
            marker=marker,
            markersize=9 if rank == 0 else 7,
            markeredgecolor="white",
            capsize=3,
            zorder=40 - rank,
        )
    else:
        label += ", no peak"
    # An empty line, whose entry in the legend shows the curve and its peak together.
    axes.plot(
        [],
        [],
        color=colour,
        linestyle=line,
        linewidth=width,
        marker=marker if fit.peak.found else "",
        markeredgecolor="white",
        markersize=8,
        label=label,
    )
