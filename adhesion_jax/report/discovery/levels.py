"""The level of each run before and after, against every column that tells runs apart."""

from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from adhesion_jax.discovery.types import Findings
from adhesion_jax.report.discovery.tables import level_columns
from adhesion_jax.report.discovery.words import column_label
from adhesion_jax.report.style import MARKS, label_text, one_legend, panels


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
        label = column_label(findings.slip if name == "slip" else name)
        axis.set_xlabel(label_text(label, 40))
        axis.xaxis.set_major_locator(MaxNLocator(4))
    one_legend(figure, axes[:1])
    return figure
