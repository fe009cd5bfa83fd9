"""A plan in words, tables and the map: the noise, the errors, and what would be enough."""

from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from adhesion_jax.planning.plan import ROUGH, UNDETERMINED, OwnLog, Plan, Present, Wanted
from adhesion_jax.planning.truth import curve_of
from adhesion_jax.report.rendering import text_of
from adhesion_jax.report.style import Shown, label_text, one_legend
from adhesion_jax.wording import number

#: Half the width of a 95 % interval in standard errors.
_QUANTILE = 1.96

#: A smaller misfit than this share of the adhesion is not worth a word.
_SLIGHT = 5e-4

QUANTITIES = ("mu_max", "slip_opt")

#: What a relative standard error is worth.
DETERMINED, ROUGHLY, NOT_DETERMINED = "determined", "rough", "not determined"


def plan_rows(plan: Plan) -> pd.DataFrame:
    """One row for each largest slip and number of samples.

    Columns: largest_slip, samples, runs, the relative standard error of mu_max and of slip_opt
    (`_relative_se`; infinite where the samples do not determine it) with what it is worth, and
    whether the peak lies beyond the slips.
    """
    rows = []
    for i, largest in enumerate(plan.largest_slips):
        for j, samples in enumerate(plan.samples):
            excitation = plan.planner.design(samples)
            row: dict[str, object] = {
                "largest_slip": largest,
                "samples": round(excitation.samples),
                "runs": excitation.runs,
            }
            for name, error in zip(QUANTITIES, plan.errors[i, j], strict=True):
                row[f"{name}_relative_se"] = error
                row[name] = worth(error, plan.errors[i, j, 1])
            row["peak_beyond_slips"] = largest < plan.planner.peak.slip_opt
            rows.append(row)
    return pd.DataFrame(rows)


def wanted_rows(plan: Plan, wanted: Wanted) -> pd.DataFrame:
    """One row for each largest slip: the fewest samples for the error that is wanted."""
    return pd.DataFrame(
        {
            "largest_slip": plan.largest_slips,
            "mu_max_relative_se": wanted.error,
            "samples": wanted.samples,
        }
    )


def worth(error: float, slip_opt_error: float) -> str:
    """What a relative standard error is worth, in a word."""
    if not error <= UNDETERMINED:
        return NOT_DETERMINED
    return ROUGHLY if slip_opt_error > ROUGH else DETERMINED


def per_cent(share: float) -> str:
    """A share in per cent with two digits."""
    value = 100 * share
    decimals = max(0, 1 - int(np.floor(np.log10(value)))) if 0 < value < np.inf else 0
    return f"{value:.{decimals}f}"


def told(
    source: str, plan: Plan, log: OwnLog | None, present: Present | None, wanted: Wanted | None
) -> str:
    """The whole plan for a terminal."""
    errors, planner = plan.errors, plan.planner
    values = (planner.peak.mu_max, planner.peak.slip_opt)
    quantities = (
        [
            (name, value, _QUANTILE * error * value, error, further)
            for name, value, error, further in zip(
                QUANTITIES, values, present.errors, present.further, strict=True
            )
        ]
        if present
        else []
    )
    return text_of(
        "plan.txt",
        source=source,
        plan=plan,
        log=log,
        present=present,
        wanted=wanted,
        free=curve_of(planner.truth.law).free,
        tables={name: _table(plan, place) for place, name in enumerate(QUANTITIES)},
        some_undetermined=np.any(~(errors <= UNDETERMINED)),
        some_rough=np.any((errors[..., 1] > ROUGH) & (errors[..., 0] <= UNDETERMINED)),
        quantities=quantities,
        reached=wanted and np.isfinite(wanted.cheapest),
        wanted_table=wanted and _wanted_table(plan, wanted),
        per_cent=per_cent,
        slight=_SLIGHT,
        undetermined=UNDETERMINED,
        rough=ROUGH,
    )


def _table(plan: Plan, quantity: int) -> str:
    unit = plan.planner.truth.slip_unit.strip()
    heading = f"largest slip{f' ({unit})' if unit else ''}"
    cells = {heading: [number(slip) for slip in plan.largest_slips]}
    for j, samples in enumerate(plan.samples):
        column = plan.errors[:, j]
        cells[f"{samples:,.0f}"] = [_cell(row[quantity], row[1]) for row in column.tolist()]
    lines = pd.DataFrame(cells).to_string(index=False).splitlines()
    return "\n".join([f"{'':{len(heading)}}  number of samples", *lines])


def _cell(error: float, slip_opt_error: float) -> str:
    word = worth(error, slip_opt_error)
    if word == NOT_DETERMINED:
        return "n.d."
    return f"({per_cent(error)})" if word == ROUGHLY else per_cent(error)


def _wanted_table(plan: Plan, wanted: Wanted) -> str:
    cells = {
        "largest slip": [number(slip) for slip in plan.largest_slips],
        "samples": [
            f"{samples:,.0f}" if np.isfinite(samples) else "not reached"
            for samples in wanted.samples
        ],
    }
    return pd.DataFrame(cells).to_string(index=False)


#: Relative standard errors of the contour lines.
_LEVELS = np.array([1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 0.01, 0.02, 0.05, 0.1, 0.3, 1.0])

#: Colour of what halves an error or reaches a wanted one: dark in grey, too.
_RED = "#A11D1D"

_PLACE: dict[str, Any] = {
    "linestyle": "",
    "markeredgecolor": "white",
    "markersize": 11,
    "zorder": 10,
}


def plan_figure(source: str, plan: Plan, present: Present | None, wanted: Wanted | None) -> Figure:
    """A panel each for mu_max and slip_opt, with one's own log and what would halve its error.

    The plan has enough largest slips for smooth lines.
    """
    figure = Shown(figsize=(11, 5.6), layout="constrained")
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    for place, (axes, name) in enumerate(zip(panels, QUANTITIES, strict=True)):
        _map(axes, plan, plan.errors[..., place])
        axes.set_title(f"standard error of {name} in % of its value", loc="left", fontsize=11)
        if plan.largest_slips[0] < plan.planner.peak.slip_opt < plan.largest_slips[-1]:
            height = plan.planner.peak.slip_opt
            axes.axhline(height, color="black", linestyle=":", label="slip of the peak")
        if present is not None:
            _places(axes, plan, present, place)
    if wanted is not None:
        _wanted(panels[0], plan, wanted)
    unit = plan.planner.truth.slip_unit.strip() or "1"
    panels[0].set_ylabel(f"largest slip ({unit})")
    figure.suptitle(label_text(source, 90), x=0.01, ha="left", fontsize=12)
    one_legend(figure, panels, loc="outside lower center", ncols=5, fontsize=None)
    return figure


def _map(axes: Axes, plan: Plan, errors: Float[np.ndarray, "slips numbers"]) -> None:
    shown = np.log10(np.clip(errors, _LEVELS[0], 2 * _LEVELS[-1]))
    place, levels = (plan.samples, plan.largest_slips), np.log10([*_LEVELS, 3 * _LEVELS[-1]])
    axes.contourf(*place, shown, levels, cmap="Blues", vmin=shown.min() - 0.3, vmax=shown.max() + 1)
    lines = axes.contour(*place, shown, levels, colors="0.15", linewidths=0.9, linestyles="solid")
    axes.clabel(lines, fmt=lambda level: f"{round(100 * 10**level, 2):g} %", fontsize=9)
    axes.set(xscale="log", yscale="log", xlabel="number of samples")
    for axis, steps in (
        (axes.xaxis, (1.0, 2.0, 5.0)),
        (axes.yaxis, (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)),
    ):
        axis.set_major_locator(LogLocator(subs=steps))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,g}"))
        axis.set_minor_formatter(NullFormatter())


def _line(
    axes: Axes, plan: Plan, errors: Float[np.ndarray, "slips numbers"], level: float, label: str
) -> None:
    """The plans of one error."""
    if errors.min() < level < errors.max():
        axes.contour(
            plan.samples,
            plan.largest_slips,
            np.log10(errors.clip(1e-9, 1e9)),
            [np.log10(level)],
            colors=_RED,
            linewidths=2.2,
            linestyles="--",
        )
        axes.plot([], [], color=_RED, linewidth=2.2, linestyle="--", label=label)


def _places(axes: Axes, plan: Plan, present: Present, quantity: int) -> None:
    """One's own log, the plans of half its error, and two of them."""
    half, more = present.errors[quantity] / 2, 4 * present.samples
    _line(axes, plan, plan.errors[..., quantity], half, "half the error of your log")
    axes.plot(present.samples, present.largest_slip, "X", color="black", label="your log", **_PLACE)
    if more <= plan.samples[-1]:
        label = "four times as many samples"
        axes.plot(more, present.largest_slip, ">", color=_RED, label=label, **_PLACE)
    further = present.further[quantity]
    if further is not None and further <= plan.largest_slips[-1]:
        axes.plot(present.samples, further, "^", color=_RED, label="further in slip", **_PLACE)


def _wanted(axes: Axes, plan: Plan, wanted: Wanted) -> None:
    """The plans of the error that is wanted, and the one of the fewest samples."""
    label = f"{100 * wanted.error:.3g} %, as wanted"
    _line(axes, plan, plan.errors[..., 0], wanted.error, label)
    if plan.samples[0] <= wanted.cheapest <= plan.samples[-1]:
        style = {**_PLACE, "markersize": 16}
        best = (wanted.cheapest, wanted.cheapest_slip)
        axes.plot(*best, "*", color=_RED, label="with the fewest samples", **style)
