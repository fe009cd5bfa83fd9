"""The page of a board: verdict in words, tables, figures, and which method when."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from adhesion_jax.leaderboard.table import COLUMNS, COSTS, top
from adhesion_jax.metrics.closed_loop import PRICES
from adhesion_jax.report.page import CAPTIONS, Items, Page, Section, Table, pictures
from adhesion_jax.report.traction.page import parameters_of
from adhesion_jax.traction.plants.reading import PlantFile
from adhesion_jax.traction.systems.base import System
from adhesion_jax.wording import listed, number, percent, plus_minus

#: A method does as well as the best where it loses less than this share of the adhesion.
_AS_WELL = 0.01

#: What no source gives, beside the parameters of the plant.
_ASSUMED = (
    "The ranges of drawn rails, .05 to .25 m/s for the slip of the peak and .06 to .36 for its "
    "adhesion, cover the three rails of the HXD1F (assumed).",
    "Segments of drawn rails last 5 s, and begin up to .5 s earlier or later (assumed).",
    "Noise of the speeds, the period of the sensors, the start at v* = .1 m/s and the largest rate "
    "of the slip asked for, 2 m/s^2, are those of all methods (assumed).",
    "The ranges that numbers are tuned in are those of each method; what was chosen stands above "
    "(assumed, and tuned).",
    "The prices of slip work, 0, 1 and 3 joules of useful work for a joule, stand for what wear "
    "costs (assumed).",
)

#: Standard errors beyond which a promise of tuning was not kept, or seeds do not agree.
_FAR = 3.0

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


def leaderboard_page(
    table: pd.DataFrame, plant: PlantFile, system: System, told: Mapping[str, Any]
) -> Page:
    """`told` is what was asked for, as the metadata have it."""
    sections = [Section("Which method when", [Items(when(table))], boxed=True)]
    for rails, part in table.groupby("rails", sort=False):
        title = f"Rails {rails}: {told['rails'].get(rails, rails)}"
        sections.append(Section(title, [table_of_rows(part, _FIRST), table_of_rows(part, _SECOND)]))
    sections.append(Section("Figures", pictures("leaderboard", CAPTIONS["leaderboard"])))
    first = table[table["rails"] == table["rails"].iloc[0]]
    sections.append(Section("What tuning chose", [tuned_numbers(first)]))
    sections.append(Section("Terms that all methods share", [Items(_terms(told, system))]))
    assumed = [Items([*_ASSUMED, *system.repairs]), *parameters_of(plant)]
    sections.append(Section("What was assumed", assumed))
    meanings = [[name, unit, words] for name, (unit, words) in COLUMNS.items()]
    sections.append(
        Section("Columns of leaderboard.csv", [Table(("column", "unit", "meaning"), meanings)])
    )
    title = f"Slip control on equal terms: {plant.title}"
    return Page(title, verdict(table, told["tuned_on"]), sections)


def verdict(table: pd.DataFrame, rails: str) -> str:
    """What is not dominated and what each of those is good at; what is not to be trusted."""
    rows = table[table["rails"] == rails]
    fair = rows[rows["remark"] == ""]
    if fair.empty:
        return f"On {rails} rails no method can be ranked."
    kept = fair[fair["dominated_by"] == ""]
    words = [
        f"On {rails} rails, {listed([*kept['method']])} "
        f"{'is' if len(kept) == 1 else 'are'} not dominated: no other method has a larger "
        "utility at price 1 together with less torque variation and less slip energy."
    ]
    most = _row_of(fair, top(fair, "utilisation"))
    words.append(
        f"{_quoted(most['method'])} uses the largest share of the adhesion, {_share(most)}, with "
        f"{percent(most['worst'])} in its worst run; that alone makes no method the best."
    )
    for cost, what in zip(COSTS, ("torque variation", "slip energy"), strict=True):
        least = _row_of(kept, top(kept, cost, least=True))
        uses = "" if least["method"] == most["method"] else f", and uses {_share(least)}"
        words.append(f"{_quoted(least['method'])} has the least {what} of them{uses}.")
    return " ".join([*words, *doubts(table)])


def doubts(table: pd.DataFrame) -> list[str]:
    """Methods that are not ranked, promises that were not kept, and seeds that do not agree."""
    found = []
    failed = table[table["failed"] > 0]
    for _, row in failed.iterrows():
        found.append(
            f"{_quoted(row['method'])} returned what is no number in {row['failed']} of "
            f"{row['runs']} runs on {row['rails']} rails, and is not ranked there."
        )
    for _, row in table[table["promised_z"] > _FAR].iterrows():
        found.append(
            f"{_quoted(row['method'])} promised {row['promised']:.4f} on the rails that it was "
            f"tuned on and used {row['utilisation']:.4f} of the adhesion on fresh ones, "
            f"{row['promised_z']:.1f} standard errors less: its numbers suit the rails of tuning "
            "more than others."
        )
    for _, row in table[table["seeds_apart"] > _FAR].iterrows():
        found.append(
            f"Two seeds of {row['method']} on {row['rails']} rails differ by "
            f"{row['seeds_apart']:.1f} standard errors: more runs are needed."
        )
    return found


def when(table: pd.DataFrame) -> list[str]:
    """Which method does, by what one cares for, on each family of rails."""
    found = []
    for rails, rows in table.groupby("rails", sort=False):
        fair = rows[rows["remark"] == ""]
        if fair.empty:
            continue
        best = fair["utilisation"].max()
        near = fair[fair["utilisation"] >= best - _AS_WELL]
        words = [
            f"On {rails} rails, within {percent(_AS_WELL)} of the largest share of adhesion are "
            f"{listed([*near['method']])}."
        ]
        wishes = {
            "the least torque variation": ("torque_variation", True),
            "the least slip energy": ("slip_energy_share", True),
            "the shortest computing time": ("microseconds", True),
            "the best worst run": ("worst", False),
        }
        if len(near) > 1:
            of_wish: dict[str, list[str]] = {}
            for wish, (column, least) in wishes.items():
                of_wish.setdefault(top(near, column, least), []).append(wish)
            told = [f"{name} has {listed(of)}" for name, of in of_wish.items()]
            words.append(f"Of these {listed(told)}.")
        # What a rail holds at a moment may rest on what a method did before: slip cleans it.
        pull = fair.set_index("method")["pull"]
        held = pull / fair.set_index("method")["pull_share"]
        left = (held - pull).sort_values()
        hold = " to ".join(dict.fromkeys([f"{held.min():.0f}", f"{held.max():.0f}"]))
        ends = dict.fromkeys([left.index[0], left.index[-1]])
        unused = listed([f"{name} leaves {left[name]:.1f} kN" for name in ends])
        words.append(f"The rails hold {hold} kN, of which {unused} unused.")
        dear = top(fair, "utility_3")
        words.append(f"Where slip work costs three times what it takes, {dear} is worth most.")
        found.append(" ".join(words))
    return found


def _row_of(rows: pd.DataFrame, method: str) -> pd.Series:
    return rows[rows["method"] == method].iloc[0]


def _share(row: pd.Series) -> str:
    return plus_minus(100 * row["utilisation"], 100 * row["utilisation_se"]) + " %"


def _quoted(name: str) -> str:
    """A name at the start of a sentence, in quotation marks, which needs no capital."""
    return f"“{name}”"


def _terms(told: Mapping[str, Any], system: System) -> Sequence[str]:
    noise, seeds = system.noise, listed([*map(str, told["seeds"])])
    return (
        f"The plant is integrated in steps of {1e3 * told['step_s']:g} ms, controlled every "
        f"{1e3 * told['control_period_s']:g} ms, and runs for {told['duration_s']:g} s from "
        f"{system.train_speed:g} m/s. Sensors sample every millisecond, with noise of "
        f"{noise.motor:g} rad/s in the speed of the motor and {noise.train:g} m/s in that of the "
        "train.",
        f"Each method that has numbers was tuned with {told['budget']} configurations, the first "
        f"points of one scrambled Sobol sequence, on {told['tuning_rails']} drawn rails "
        f"({told['tuned_on']}, seed {told['tuning_seed']}); the configuration with the largest "
        "mean utilisation was kept. The true optima with a price have the numbers of the one "
        "without.",
        f"It was judged on {told['runs']} rails of each family for each of the seeds {seeds}, "
        "which tuning has not seen; a law from a file is one rail, whose noise alone is new. All "
        "methods have the same rails and the same noise, and differences are those of the same "
        "runs.",
        "A run of which a method makes no number is counted as failed and left out of its means; "
        "a method with a failed run is not ranked. Rows of another version of plant, rails or "
        "metrics are shown in grey and not ranked.",
        "Standard errors are those of the mean over runs. Places are by utility at price 1: useful "
        "work less the energy lost in the contact.",
    )


def table_of_rows(rows: pd.DataFrame, names: Sequence[str], folded: str = "") -> Table:
    """The columns of these names, with errors where there are some; folded under a heading."""
    # No axle of a rigid train twists.
    there = [name for name in names if name in rows and rows[name].notna().any()]
    cells = [[_cell(row, name) for name in there] for _, row in rows.iterrows()]
    headings = [f"{name} ({COLUMNS[name][0]})" if COLUMNS[name][0] else name for name in there]
    right = [
        heading
        for heading, name in zip(headings, there, strict=True)
        if pd.api.types.is_numeric_dtype(rows[name])
    ]
    quiet = [place for place, remark in enumerate(rows["remark"]) if remark]
    return Table(headings, cells, right, folded, quiet)


def tuned_numbers(rows: pd.DataFrame) -> Table:
    """The numbers of each method that was tuned, in a table of their own: they are many words."""
    there = rows[rows["tuned"] != ""]
    cells = [*zip(there["method"], there["tuned"], strict=True)]
    return Table(("method", "numbers"), cells)


def _cell(row: pd.Series, name: str) -> str:
    value = row[name]
    if isinstance(value, str):
        return value
    if pd.isna(value):
        return ""
    if f"{name}_se" in row and np.isfinite(row[f"{name}_se"]):
        return plus_minus(float(value), float(row[f"{name}_se"]))
    return number(float(value))
