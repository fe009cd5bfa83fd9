"""Which method to take when: the page and the figure on methods and scenarios, and its words."""

from collections.abc import Callable, Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from adhesion_jax.report.page import Items, Page, Paragraph, Picture, Section, Table
from adhesion_jax.wording import listed

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
    words = []
    if len(streams):
        words += [_for_a_controller(streams), _for_a_log(streams)]
    for kind, scenario in _TEXTBOOK.items():
        rows = sure[(sure["scenario"] == scenario) & sure["rmse_over_crlb"].notna()]
        if len(rows):
            words.append(_for_a_benchmark(rows, kind))
    return [*words, *_out_of_reach(table)]


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


def _for_a_controller(streams: pd.DataFrame) -> str:
    scores = _scores(streams).sort_values("ratio")
    name, best = str(scores.index[0]), scores.iloc[0]
    at_worst = _where(streams, name, "rmse_over_crlb", best["worst"])
    words = (
        f"For a controller take {name}: over {best['number']:.0f} streams its RMSE of mu_max is "
        f"{best['ratio']:.2f} times the bound in the geometric mean, and {best['worst']:.3g} times "
        f"at worst ({at_worst}). It takes {best['microseconds']:.2g} us a sample in a batch and "
        f"carries {best['bytes']:.0f} bytes."
    )
    if len(scores) > 1:
        words += f" The next one is {scores.index[1]} with {scores.iloc[1]['ratio']:.2f} times."
    return words


def _for_a_log(streams: pd.DataFrame) -> str:
    scores = _scores(streams).sort_values(["believed", "least"], ascending=False)
    name, best = str(scores.index[0]), scores.iloc[0]
    at_worst = _where(streams, name, "coverage95", best["least"])
    return (
        f"For a log, where intervals are to be believed, take {name}: on {best['believed']:.0f} of "
        f"{best['number']:.0f} streams its 95 % intervals hold the truth in at least "
        f"{100 * _BELIEVED:.0f} % of the runs, and in {100 * best['least']:.0f} % at worst "
        f"({at_worst}). Its RMSE is {best['ratio']:.2f} times the bound in the geometric mean."
    )


def _for_a_benchmark(rows: pd.DataFrame, kind: str) -> str:
    rows = rows.sort_values("rmse_over_crlb")
    best = rows.iloc[0]
    alike = rows[rows["rmse_over_crlb"] <= best["rmse_over_crlb"] + 2 * best["rmse_over_crlb_se"]]
    fastest = alike.sort_values("microseconds").iloc[0]
    what, unit = ("streams", "sample") if kind == "stream" else ("blocks", "point")
    words = (
        f"For a benchmark of methods on {what} take {fastest['identifier']}: on a constant rail in "
        f"white noise its RMSE is {fastest['rmse_over_crlb']:.2f} times the bound, and it takes "
        f"{fastest['microseconds']:.2g} us a {unit}."
    )
    if len(alike) == 1:
        return words
    return f"{words} It is the fastest of {len(alike)} that differ by two standard errors or less."


def _out_of_reach(table: pd.DataFrame) -> list[str]:
    """The scenarios on which no method comes near the bound, or has intervals to be believed."""
    best = table.groupby("scenario", sort=False)
    words = []
    far = best["rmse_over_crlb"].min()
    far = far[far > _NEAR]
    if len(far):
        where = listed([*far.index])
        words.append(f"None of these methods comes within twice the bound on {where}.")
    doubtful = best["coverage95"].max()
    doubtful = doubtful[doubtful < _BELIEVED]
    if len(doubtful):
        share, where = f"{100 * _BELIEVED:.0f} %", listed([*doubtful.index])
        words.append(
            f"None of these methods has intervals that hold the truth in {share} of the runs "
            f"on {where}."
        )
    return words


def page(table: pd.DataFrame, runs: int, picture: str) -> Page:
    """The page: the advice, the figure, and all numbers."""
    words = advice(table)
    caption = (
        "A row is a method, a column a scenario, the darker the worse; where a cell is empty the "
        "method does not take the scenario, or there is no such figure. In brackets: more than 1 % "
        "of the estimates lie on a bound of their box, which alone may bring the error below the "
        "bound that holds without a box."
    )
    how = (
        f"Over {runs} runs of each scenario. Of a stream the figures are those of the second half "
        "of each rail, of blocks those of all blocks; means over the rails of a scenario. Times "
        "are CPU-seconds in a batch, compilation excluded."
    )
    sections = [
        Section("Which method to take", [Items(words[1:])]),
        Section("Methods and scenarios", [Paragraph(how), Picture(picture, caption)]),
        Section("All numbers", [_table(table)]),
    ]
    return Page("Which method when", words[0] if words else how, sections)


def _table(table: pd.DataFrame) -> Table:
    names = [str(name) for name in table]
    numbers = [name for name in names if pd.api.types.is_numeric_dtype(table[name])]
    rows = [
        [
            (f"{value:.3g}" if np.isfinite(value) else "") if name in numbers else str(value)
            for name, value in row.items()
        ]
        for _, row in table.iterrows()
    ]
    return Table(names, rows, numbers, f"{len(rows)} rows: scenarios and methods")


def text(table: pd.DataFrame) -> str:
    """The advice and the numbers of each method, for a terminal."""
    return "\n\n".join([*advice(table), table.to_string(index=False, float_format="{:.3g}".format)])
