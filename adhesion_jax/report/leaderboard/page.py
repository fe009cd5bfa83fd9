"""The pages of a board, of rails or of disturbances: verdict, which method when, and tables."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from adhesion_jax.leaderboard.disturbances import ALL, disturbances
from adhesion_jax.leaderboard.table import COLUMNS, COSTS, top
from adhesion_jax.metrics.closed_loop import PRICES
from adhesion_jax.report.page import CAPTIONS, Page, Table
from adhesion_jax.report.rendering import page_of, sentences_of
from adhesion_jax.report.traction.page import columns_table, words_of_plant
from adhesion_jax.traction.plants.reading import TAGS, PlantFile
from adhesion_jax.traction.systems.base import System
from adhesion_jax.wording import number, plus_minus

#: A method does as well as the best where it loses less than this share of the adhesion.
_AS_WELL = 0.01

#: Standard errors beyond which a promise of tuning was not kept, seeds do not agree, or a method is
#: ahead of another.
_FAR = 3.0

#: Below this share of the adhesion a disturbance costs a method much.
_MUCH = 0.98

#: The columns of the first table, those whose errors are told beside them, and of the second.
_FIRST = (
    *("rank", "method", "utilisation", "worst", "difference", "never95", "t95_median", "t95_p90"),
    *("pull", "pull_share", "torque_variation", "axle_torque_median", "axle_torque_p95"),
    *("slip_energy_share", "jerk_rms", "microseconds", "state_bytes", "remark"),
)
_SECOND = (
    "method",
    *(name for price in PRICES for name in (f"utility_{price}", f"utility_{price}_share")),
    *("dominated_by", "promised", "promised_z", "seeds_apart"),
)

#: The columns of the tables of the robust track.
_ROBUST = (
    *("rank", "method", "utilisation", "worst", "difference", "never95", "utility_1_share"),
    *("axle_torque_median", "axle_torque_p95", "torque_variation", "remark"),
)

#: What one may care for among methods that do as well: the column, and whether less is better.
_WISHES = {
    "the least torque variation": ("torque_variation", True),
    "the least slip energy": ("slip_energy_share", True),
    "the shortest computing time": ("microseconds", True),
    "the best worst run": ("worst", False),
}


def leaderboard_page(
    table: pd.DataFrame, plant: PlantFile, system: System, told: Mapping[str, Any]
) -> Page:
    """`told` is what was asked for, as the metadata have it."""
    rails = [(name, part) for name, part in table.groupby("rails", sort=False)]
    return page_of(
        "leaderboard_page.txt",
        f"Slip control on equal terms: {plant.title}",
        verdict(table, told["tuned_on"]),
        CAPTIONS["leaderboard"],
        when=when(table),
        rails=[
            (name, table_of_rows(part, _FIRST), table_of_rows(part, _SECOND))
            for name, part in rails
        ],
        tuned=_tuned_numbers(rails[0][1]),
        told=told,
        system=system,
        pictures=CAPTIONS["leaderboard"],
        columns=columns_table(COLUMNS),
        **words_of_plant(plant),
    )


def robust_page(
    table: pd.DataFrame, plant: PlantFile, system: System, told: Mapping[str, Any]
) -> Page:
    """The same of the robust track, whose rails are disturbances."""
    rows, there = table[table["rails"] == ALL], table[table["rails"] != ALL]
    listing = [
        [name, one.words, TAGS[one.tag], "tuned and judged" if one.tuned_on else "judged"]
        for name, one in disturbances().items()
    ]
    heading = ("disturbance", "what the method does not know", "its level is", "used")
    return page_of(
        "robust_page.txt",
        f"Slip control under disturbances: {plant.title}",
        robust_verdict(table),
        CAPTIONS["robust"],
        best_under=_best_under(there),
        means=table_of_rows(rows, _ROBUST),
        listing=Table(heading, listing),
        under=[
            table_of_rows(part, _ROBUST, folded=f"{name}: {told['rails'][name]}")
            for name, part in there.groupby("rails", sort=False)
        ],
        tuned=_tuned_numbers(rows),
        system=system,
        columns=columns_table(COLUMNS),
        **words_of_plant(plant),
    )


def verdict(table: pd.DataFrame, rails: str) -> str:
    """What is not dominated and what each of those is good at; what is not to be trusted."""
    fair = _ranked(table[table["rails"] == rails])
    kept = fair[fair["dominated_by"] == ""]
    least = [] if fair.empty else [_top(kept, cost, least=True) for cost in COSTS]
    told = sentences_of(
        "leaderboard_verdict.txt",
        rails=rails,
        kept=[*kept["method"]],
        most=None if fair.empty else _top(fair, "utilisation"),
        least=zip(least, ("torque variation", "slip energy"), strict=False),
        rows=table.to_dict("records"),
        far=_FAR,
    )
    return " ".join(told)


def when(table: pd.DataFrame) -> list[str]:
    """Which method does, by what one cares for, on each family of rails."""
    rails = [(name, _ranked(rows)) for name, rows in table.groupby("rails", sort=False)]
    return sentences_of(
        "leaderboard_when.txt",
        rails=[_choices(str(name), fair) for name, fair in rails if len(fair)],
        as_well=_AS_WELL,
    )


def _choices(rails: str, fair: pd.DataFrame) -> Mapping[str, Any]:
    """The methods near the best on some rails, what each is good at, and the pull left unused."""
    near = fair[fair["utilisation"] >= fair["utilisation"].max() - _AS_WELL]
    of_wish: dict[str, list[str]] = {}
    for wish, (column, least) in _WISHES.items() if len(near) > 1 else ():
        of_wish.setdefault(top(near, column, least), []).append(wish)
    # What a rail holds at a moment may rest on what a method did before: slip cleans it.
    pull = fair.set_index("method")["pull"]
    held = pull / fair.set_index("method")["pull_share"]
    left = (held - pull).sort_values()
    return {
        "rails": rails,
        "near": [*near["method"]],
        "of_wish": of_wish,
        "held": [*dict.fromkeys([f"{held.min():.0f}", f"{held.max():.0f}"])],
        "left": {name: left[name] for name in (left.index[0], left.index[-1])},
        "dear": top(fair, "utility_3"),
    }


def robust_verdict(table: pd.DataFrame) -> str:
    """Who is best in the mean over disturbances and by how much, and where it loses."""
    rows = _ranked(table[table["rails"] == ALL])
    if rows.empty:
        return "No method can be ranked."
    best = _top(rows, "utilisation")
    others = rows[rows["method"] != best["method"]]
    near = others[-others["difference"] <= _FAR * others["difference_se"]]
    own = table[(table["method"] == best["method"]) & (table["rails"] != ALL)]
    told = sentences_of(
        "robust_verdict.txt",
        best=best,
        count=table["rails"].nunique() - 1,  # all of them are rails, too
        second=_top(others, "utilisation") if len(others) else None,
        near=[*near["method"]],
        poor=own[own["utilisation"] < _MUCH].to_dict("records"),
        much=_MUCH,
        torque=own["axle_torque_p95"].max(),
    )
    return " ".join(told)


def _best_under(table: pd.DataFrame) -> Mapping[str, list[str]]:
    """The methods that are best, by the disturbances that they are best under."""
    found: dict[str, list[str]] = {}
    for name, rows in table.groupby("rails", sort=False):
        if len(fair := _ranked(rows)):
            found.setdefault(top(fair, "utilisation"), []).append(str(name))
    return found


def _ranked(rows: pd.DataFrame) -> pd.DataFrame:
    return rows[rows["remark"] == ""]


def _top(rows: pd.DataFrame, column: str, least: bool = False) -> Mapping[Any, Any]:
    """The row of the largest value in a column, or of the least."""
    return rows[rows["method"] == top(rows, column, least)].iloc[0].to_dict()


def table_of_rows(rows: pd.DataFrame, names: Sequence[str], folded: str = "") -> Table:
    """The columns of these names, with errors where there are some; folded under a heading."""
    # No axle of a rigid train twists.
    there = [name for name in names if name in rows and rows[name].notna().any()]
    headings = {name: f"{name} ({unit})" if (unit := COLUMNS[name][0]) else name for name in there}
    return Table(
        [*headings.values()],
        [[_cell(row, name) for name in there] for _, row in rows.iterrows()],
        [headings[name] for name in there if pd.api.types.is_numeric_dtype(rows[name])],
        folded,
        [place for place, remark in enumerate(rows["remark"]) if remark],
    )


def _cell(row: pd.Series, name: str) -> str:
    value = row[name]
    if isinstance(value, str):
        return value
    if pd.isna(value):
        return ""
    if f"{name}_se" in row and np.isfinite(row[f"{name}_se"]):
        return plus_minus(float(value), float(row[f"{name}_se"]))
    return number(float(value))


def _tuned_numbers(rows: pd.DataFrame) -> Table:
    """The numbers of each method that was tuned, in a table of their own: they are many words."""
    there = rows[rows["tuned"] != ""]
    return Table(("method", "numbers"), [*zip(there["method"], there["tuned"], strict=True)])
