"""Which method to take when: the page and the figure on methods and scenarios, and its words."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from adhesion_jax.report.page import CAPTIONS, Page, table_of
from adhesion_jax.report.rendering import page_of, sentences_of

#: Intervals can be believed that hold the truth in at least this share of the runs.
_BELIEVED = 0.90

#: A method comes near the bound where its RMSE is at most this multiple of it.
_NEAR = 2.0

#: A method that fails more often than this is not advised.
_FAILS = 0.01

#: The scenarios of a constant rail in white noise, whose curve is the one told.
_TEXTBOOK = {"stream": "stream", "blocks": "single"}

#: Columns of the overview, what they are called, how a cell is written, and the scale of a colour.
_PANELS: Sequence[tuple[str, str, Callable[[float], str], Normalize]] = (
    ("rmse_over_crlb", "RMSE of mu_max over the bound", lambda x: f"{x:.3g}", LogNorm(1, 30)),
    ("coverage95", "coverage of 95 % intervals", lambda x: f"{x:.2f}", Normalize(0, 1)),
    ("delay", "median delay after a switch (steps)", lambda x: f"{x:.3g}", LogNorm(1, 500)),
    ("false_resets_per_1000", "false resets per 1000 steps", lambda x: f"{x:.2g}", Normalize(0, 5)),
)


def figure(table: pd.DataFrame) -> Figure:
    """A panel for each figure: a column for each scenario, a row for each method that has one."""
    ordered = table.sort_values("kind", ascending=False, kind="stable")  # streams first
    scenarios = list(dict.fromkeys(ordered["scenario"]))
    of = {
        panel: list(dict.fromkeys(ordered[ordered[panel[0]].notna()]["identifier"]))
        for panel in _PANELS
    }
    of = {panel: names for panel, names in of.items() if names}
    heights = [0.28 * len(names) + 0.6 for names in of.values()]
    size = (0.5 * len(scenarios) + 3.0, sum(heights) + 1.6)
    drawn = Figure(figsize=size, dpi=110, layout="constrained")
    axes = drawn.subplots(len(of), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
    for axis, ((column, title, written, scale), names) in zip(axes, of.items(), strict=True):
        found = table.set_index(["identifier", "scenario"])[column]
        cells = found.reindex(pd.MultiIndex.from_product((names, scenarios)))
        values = cells.to_numpy(dtype=float).reshape(len(names), -1)
        _cells(axis, values, written, scale, column == "coverage95")
        if column == "rmse_over_crlb":
            _bracketed(axis, table[table["cut_off"]], names, scenarios)
        axis.set_yticks(range(len(names)), names, fontsize=8)
        axis.tick_params(length=0)
        axis.set_title(title, fontsize=10)
    axes[-1].set_xticks(range(len(scenarios)), scenarios, rotation=90, fontsize=8)
    return drawn


def _cells(
    axis: Axes,
    values: NDArray[np.float64],
    written: Callable[[float], str],
    scale: Normalize,
    more_is_better: bool,
) -> None:
    """Numbers in grey cells, the darker the worse."""
    shades = np.asarray(scale(np.clip(values, scale.vmin, scale.vmax)).filled(np.nan))
    shades = 1 - shades if more_is_better else shades
    axis.imshow(np.clip(shades, 0, 1), cmap="Greys", vmin=0, vmax=1.3, aspect="auto")
    for (row, column), value in np.ndenumerate(values):
        if np.isfinite(value):
            ink = "white" if shades[row, column] > 0.7 else "black"
            axis.text(column, row, written(value), ha="center", va="center", fontsize=7, color=ink)


def _bracketed(
    axis: Axes, rows: pd.DataFrame, names: Sequence[str], scenarios: Sequence[str]
) -> None:
    """Brackets about the numbers of these rows."""
    cells = {
        (scenarios.index(scenario), names.index(name))
        for scenario, name in zip(rows["scenario"], rows["identifier"], strict=True)
    }
    for text in axis.texts:
        if text.get_position() in cells:
            text.set_text(f"({text.get_text()})")


def advice(table: pd.DataFrame) -> list[str]:
    """Which method to take for a controller, a log and a benchmark, and what none can do."""
    table = table.assign(rmse_over_crlb=table["rmse_over_crlb"].mask(table["cut_off"]))
    sure = table[table["failure_share"] <= _FAILS]
    streams = sure[sure["kind"] == "stream"]
    scores = _scores(streams) if len(streams) else pd.DataFrame()
    best = table.groupby("scenario", sort=False)
    nearest, surest = best["rmse_over_crlb"].min(), best["coverage95"].max()
    return sentences_of(
        "overview.txt",
        by_ratio=_ordered(scores, "ratio"),
        by_coverage=_ordered(scores, "believed", "least", ascending=False),
        alike={kind: _alike(sure, scenario) for kind, scenario in _TEXTBOOK.items()},
        far=[*nearest[nearest > _NEAR].index],
        doubtful=[*surest[surest < _BELIEVED].index],
        believed=100 * _BELIEVED,
        where=partial(_where, streams),
    )


def _ordered(scores: pd.DataFrame, *columns: str, ascending: bool = True) -> list[Any]:
    if scores.empty:
        return []
    return scores.sort_values([*columns], ascending=ascending).reset_index().to_dict("records")


def _alike(sure: pd.DataFrame, scenario: str) -> list[Any]:
    """The methods on a scenario that differ from the best by two standard errors, fastest first."""
    rows = sure[(sure["scenario"] == scenario) & sure["rmse_over_crlb"].notna()]
    if rows.empty:
        return []
    rows = rows.sort_values("rmse_over_crlb")
    best = rows.iloc[0]
    near = rows[rows["rmse_over_crlb"] <= best["rmse_over_crlb"] + 2 * best["rmse_over_crlb_se"]]
    return near.sort_values("microseconds").to_dict("records")


def _scores(streams: pd.DataFrame) -> pd.DataFrame:
    """A row for each method that ran on all streams that most methods take: its worth on them."""
    takers = streams.groupby("scenario")["identifier"].transform("count")
    streams = streams[takers > takers.max() / 2]
    many = streams.groupby("identifier", sort=False)
    scores = pd.DataFrame(
        {
            "ratio": many["rmse_over_crlb"].agg(lambda x: float(np.exp(np.mean(np.log(x))))),
            "worst": many["rmse_over_crlb"].max(),
            "believed": many["coverage95"].agg(lambda x: int((x >= _BELIEVED).sum())),
            "least": many["coverage95"].min(),
            "number": many["scenario"].count(),
            "microseconds": many["microseconds"].median(),
            "bytes": many["bytes"].max(),
        }
    )
    return scores[scores["number"] == scores["number"].max()]


def _where(streams: pd.DataFrame, name: str, column: str, value: float) -> str:
    rows = streams[(streams["identifier"] == name) & (streams[column] == value)]
    return str(rows["scenario"].iloc[0])


def page(table: pd.DataFrame, runs: int) -> Page:
    """The page: the advice, the figure, and all numbers."""
    words = advice(table)
    numbers = table_of(table, 3, f"{len(table)} rows: scenarios and methods")
    told = {"words": words[1:], "runs": runs, "numbers": numbers}
    verdict = words[0] if words else f"{runs} runs of each scenario."
    captions = CAPTIONS["montecarlo"]
    return page_of("overview_page.txt", "Which method when", verdict, captions, **told)


def text(table: pd.DataFrame) -> str:
    """The advice and the numbers of each method, for a terminal."""
    return "\n\n".join([*advice(table), table.to_string(index=False, float_format="{:.3g}".format)])
