"""Published claims and the numbers computed here: the table and the figures."""

from collections.abc import Iterable, Mapping
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from adhesion_jax.curves import Curve
from adhesion_jax.report.montecarlo.figures import LABELS
from adhesion_jax.report.rendering import with_errors
from adhesion_jax.report.style import line_styles
from adhesion_jax.report.traction.panels import Line, Mark, Panel, draw
from experiments.claims.claim import Claim, Numbers, values
from experiments.claims.he2018 import Fit
from experiments.claims.traction import Found


def claims_table(claims: Iterable[Claim]) -> pd.DataFrame:
    return pd.DataFrame(list(claims), columns=list(Claim._fields))


def claims_text(table: pd.DataFrame) -> str:
    """The table as text: numbered lines, then a remark on each."""
    width = max(map(len, table["claim"]))
    ours = with_errors(table["ours"], table["ours_error"])
    lines = pd.DataFrame(
        {
            "claim": [claim.ljust(width) for claim in table["claim"]],
            "paper's": [f"{x:.4g}" if np.isfinite(x) else "" for x in table["paper_number"]],
            "ours": np.where(table["ours"].isna(), "", ours),
            "unit": list(table["unit"]),
            "verdict": [_verdict(*row) for row in table[_TOLD].itertuples(index=False)],
            "rests on": list(table["rests_on"]),
        },
        index=pd.RangeIndex(1, len(table) + 1),
    )
    remarks = [f"{number:>3}  {text}" for number, text in enumerate(table["remark"], start=1)]
    return "\n".join([lines.to_string(justify="left"), "", *remarks])


#: What the verdict of a row is told from.
_TOLD = ["verdict", "share_low", "share_high", "deciding_runs"]


def _verdict(words: str, low: float, high: float, runs: float) -> str:
    """The verdict with the interval of its share, or with the runs that would decide it."""
    if np.isfinite(low):
        return f"{words} ({low:.0f} to {high:.0f})"
    if np.isnan(runs):
        return words
    return f"{words} ({f'{runs:.0f} runs' if np.isfinite(runs) else 'no number of runs'} would do)"


def counts_text(table: pd.DataFrame) -> str:
    """The number of rows with each verdict, by paper."""
    kinds = table["verdict"].str.replace(r"\d+ % of", "a share of", regex=True)
    return pd.crosstab(table["paper"], kinds).to_string()


def settings(path: Path, found: Found) -> None:
    """An outcome over a setting, a point a drawn setting; filled where the claim holds."""
    figure = Figure(figsize=(7.0, 4.2), layout="constrained")
    axis, said = figure.subplots(), found.paper.cloud
    all_x = values(found.settings, said["setting"])
    x, y, holds = all_x[1:], found.numbers[1:], found.holds[1:]
    for chosen, face, words in ((holds, "black", "holds"), (~holds, "none", "does not hold")):
        label = f"{words}, {np.sum(chosen)} of {len(x)}"
        axis.plot(x[chosen], y[chosen], "ko", markerfacecolor=face, markersize=5, label=label)
    axis.plot(all_x[0], found.numbers[0], "*", color="#7A0019", markersize=13, label="our setting")
    axis.set(xlabel=said["x_label"], ylabel=said["y_label"])
    axis.set_title(said["title"], fontsize=10)
    if x.max() > 10 * x.min():
        axis.set_xscale("log")
    axis.grid(color="0.9")
    axis.legend(fontsize=8)
    figure.savefig(path, dpi=130)


def curves(path: Path, papers: Mapping[str, Mapping[str, Curve]]) -> None:
    """The curves of adhesion that papers draw in their first figures, a panel a paper."""
    slip = jnp.linspace(0.0, 0.5, 501)
    panels = []
    for title, known in papers.items():
        lines = [Line(name, slip, curve(slip, {})) for name, curve in known.items()]
        peaks = [curve.peak({}) for curve in known.values()]
        marks = [Mark("largest adhesion", float(one.slip), float(one.adhesion)) for one in peaks]
        panels.append(Panel(title, "slip ratio (1)", "adhesion (1)", lines, marks, (0.0, 0.9)))
    draw(path, panels)


def consistency(path: Path, table: pd.DataFrame, fits: Mapping[str, Fit]) -> None:
    """RMSE and Cramer-Rao bound against the number of points (He et al. 2018, Eq. 15).

    `table` has the columns points, quantity, rmse, rmse_se and crlb.
    """
    figure = Figure(figsize=(8.5, 6.6), layout="constrained")
    for axis, (quantity, fit) in zip(figure.subplots(2, 2).ravel(), fits.items(), strict=True):
        rows = table[table["quantity"] == quantity]
        axis.plot(rows["points"], rows["crlb"], color="0.55", label="Cramér-Rao bound")
        axis.errorbar(
            rows["points"],
            rows["rmse"],
            rows["rmse_se"],
            color="black",
            linestyle="none",
            marker="o",
            markersize=5,
            markerfacecolor="none",
            label=f"exact optimum, slope {fit.slope:.3f} ± {fit.slope_error:.3f}",
        )
        axis.set(xscale="log", yscale="log", xlabel="points in the block (1)")
        axis.set_xticks(rows["points"], [str(n) for n in rows["points"]])
        axis.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.yaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
        axis.minorticks_off()
        axis.set_ylabel(f"RMSE of {LABELS[quantity]}")
        axis.grid(color="0.9")
        axis.legend(fontsize=8)
    figure.savefig(path, dpi=150)


def generations(
    path: Path, needed: Mapping[tuple[str, str], Mapping[str, Numbers]], most: int, goal: str
) -> None:
    """Share of the runs that have reached the optimum, against the generation.

    `needed` has a panel each (row title, column title), and in it for each method the
    generations that its runs needed, infinity where that was more than `most`.
    """
    rows = list(dict.fromkeys(row for row, _ in needed))
    columns = list(dict.fromkeys(column for _, column in needed))
    figure = Figure(figsize=(9, 6.6), layout="constrained")
    axes = figure.subplots(len(rows), len(columns), sharex=True, sharey=True, squeeze=False)
    for (row, column), methods in needed.items():
        axis = axes[rows.index(row), columns.index(column)]
        styles = line_styles(list(methods))
        for name, of_runs in methods.items():
            counts = of_runs.ravel()
            share = np.mean(counts[:, None] <= np.arange(most + 1), axis=0)
            never = 100 * np.mean(np.isinf(counts))
            style = {key: styles[name][key] for key in ("color", "linestyle")}
            axis.step(
                np.arange(most + 1),
                share,
                where="post",
                linewidth=1.6,
                label=f"{name}: median {_count(float(np.median(counts)))}, {never:.1f} % never",
                **style,
            )
        axis.axhline(0.5, color="0.8", linewidth=1, zorder=0)
        axis.set_title(f"{row}, {column}", fontsize=10)
        axis.legend(fontsize=8, loc="lower right")
        axis.set(xlim=(0, most), ylim=(0, 1.02))
    for axis in axes[-1]:
        axis.set_xlabel("generation (1)")
    for axis in axes[:, 0]:
        axis.set_ylabel(f"share of runs\n{goal} (1)")
    figure.savefig(path, dpi=150)


def _count(x: float) -> str:
    return f"{x:g}" if np.isfinite(x) else "beyond"


def factorial(path: Path, table: pd.DataFrame, factors: Mapping[str, tuple[str, str]]) -> None:
    """RMSE before a switch against the delay after it, a point a variant (Qian et al. 2024).

    A panel without outliers and one with. `factors` has the two settings of each factor.
    """
    figure = Figure(figsize=(11, 5.6), layout="constrained")
    axes = figure.subplots(1, 2)
    for axis, suffix, title in zip(
        axes, ("", "_outliers"), ("Gaussian noise", "3 % outliers"), strict=True
    ):
        for index, marker in zip(range(len(table)), "osD^vP*X", strict=True):
            row = table.iloc[index]
            settings = [(name, pair[row[name]]) for name, pair in factors.items()]
            axis.errorbar(
                row[f"delay{suffix}"],
                100 * row[f"rmse{suffix}"],
                100 * row[f"rmse{suffix}_se"],
                row[f"delay{suffix}_se"],
                label=", ".join(f"{name} {setting}" for name, setting in settings),
                color="black",
                linestyle="none",
                elinewidth=0.7,
                marker=marker,
                markersize=8,
                markerfacecolor="white" if index % 2 else "0.6",
            )
        axis.set_xscale("log")
        axis.set_xticks([20, 50, 100, 200, 500], labels=["20", "50", "100", "200", "500"])
        axis.xaxis.set_minor_formatter(NullFormatter())
        axis.set(
            title=title,
            xlabel="mean delay after the switch (samples; 500: never tracked)",
            ylabel=r"RMSE of $\mu_{max}$ before the switch (% of truth)",
        )
    figure.legend(
        *axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2, fontsize=8
    )
    figure.savefig(path, dpi=150)
