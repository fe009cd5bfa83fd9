"""The page of the robust track: verdict, which method when, map, and what is assumed."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from adhesion_jax.leaderboard.disturbances import ALL, disturbances
from adhesion_jax.leaderboard.table import COLUMNS, top
from adhesion_jax.report.leaderboard.page import table_of_rows, tuned_numbers
from adhesion_jax.report.page import CAPTIONS, Items, Page, Section, Table, pictures
from adhesion_jax.report.traction.page import parameters_of
from adhesion_jax.traction.plants.reading import TAGS, PlantFile
from adhesion_jax.traction.systems.base import System
from adhesion_jax.wording import listed, plus_minus

_SHOWN = (
    *("rank", "method", "utilisation", "worst", "difference", "never95", "utility_1_share"),
    *("axle_torque_median", "axle_torque_p95", "torque_variation", "remark"),
)

#: Below this share of the adhesion a disturbance costs a method much.
_MUCH = 0.98

#: A method leads where it is ahead by so many standard errors.
_SURE = 3.0

#: What belongs to a vehicle, and stands here for one of which nothing is published.
_REPLACE = (
    "The frequency and the damping of the wheelset, and the inertia beyond its shaft, are those of "
    "no vehicle: a torsional measurement of the axle replaces the three levels (assumed).",
    "Lag and dead time of the drive are levels: a step of the torque demand, at standstill with "
    "the brake on, replaces them (assumed).",
    "Noise, pulses and the reading of the encoder are levels: its data sheet and a log at constant "
    "speed replace them (assumed).",
    "Radius and load of the wheels vary between two turnings and with the supplies: the workshop's "
    "limits replace 1 % and 10 % (assumed).",
)


def robust_page(
    table: pd.DataFrame, plant: PlantFile, system: System, told: Mapping[str, Any]
) -> Page:
    """`told` is what was asked for, as the metadata have it."""
    rows = table[table["rails"] == ALL]
    there = table[table["rails"] != ALL]
    listing = [
        [name, one.words, TAGS[one.tag], "tuned and judged" if one.tuned_on else "judged"]
        for name, one in disturbances().items()
    ]
    heading = ("disturbance", "what the method does not know", "its level is", "used")
    sections = [
        Section("Which method when", [Items(when(there))], boxed=True),
        Section("Mean over all disturbances", [table_of_rows(rows, _SHOWN)]),
        Section("Figures", pictures("robust", CAPTIONS["robust"])),
        Section("The disturbances", [Table(heading, listing)]),
        Section(
            "Under each disturbance",
            [
                table_of_rows(part, _SHOWN, folded=f"{name}: {told['rails'][name]}")
                for name, part in there.groupby("rails", sort=False)
            ],
        ),
        Section("What tuning chose", [tuned_numbers(rows)]),
        Section("What was assumed", [Items([*_REPLACE, *system.repairs]), *parameters_of(plant)]),
        Section(
            "Columns of robustness.csv",
            [
                Table(
                    ("column", "unit", "meaning"),
                    [[name, unit, words] for name, (unit, words) in COLUMNS.items()],
                )
            ],
        ),
    ]
    title = f"Slip control under disturbances: {plant.title}"
    return Page(title, verdict(table), sections)


def verdict(table: pd.DataFrame) -> str:
    """Who is best in the mean over disturbances and by how much, and where it loses."""
    rows = table[(table["rails"] == ALL) & (table["remark"] == "")]
    if rows.empty:
        return "No method can be ranked."
    best = top(rows, "utilisation")
    row = rows[rows["method"] == best].iloc[0]
    share = plus_minus(100 * row["utilisation"], 100 * row["utilisation_se"])
    count = table["rails"].nunique() - 1  # all of them are rails, too
    words = [
        f"In the mean over {count} disturbances “{best}” uses {share} % of the adhesion; its "
        f"worst run uses {100 * row['worst']:.1f} %."
    ]
    others = rows[rows["method"] != best]
    if len(others):
        near = others[-others["difference"] <= _SURE * others["difference_se"]]
        second = top(others, "utilisation")
        by = others[others["method"] == second].iloc[0]
        ahead = plus_minus(-100 * by["difference"], 100 * by["difference_se"])
        words.append(
            f"It is ahead of “{second}”, the second, by {ahead} % of the adhesion in the same runs."
            if near.empty
            else f"Within three standard errors of it are {listed([*near['method']])}: more runs "
            "are needed to tell them apart."
        )
    own = table[(table["method"] == best) & (table["rails"] != ALL)]
    poor = own[own["utilisation"] < _MUCH]
    if len(poor):
        told = [f"{one['rails']} ({100 * one['utilisation']:.2f} %)" for _, one in poor.iterrows()]
        words.append(f"It uses less than {100 * _MUCH:.0f} % under {listed(told)}.")
    torque = own["axle_torque_p95"].max()
    if np.isfinite(torque):
        words.append(
            f"In 95 % of the runs on axles that twist, the shaft bears at most {torque:.2f} times "
            "its static torque."
        )
    return " ".join(words)


def when(table: pd.DataFrame) -> list[str]:
    """The methods that are best, by the disturbances that they are best under."""
    found: dict[str, list[str]] = {}
    for name, rows in table.groupby("rails", sort=False):
        fair = rows[rows["remark"] == ""]
        if len(fair):
            found.setdefault(top(fair, "utilisation"), []).append(str(name))
    return [f"{method} uses most under {listed(names)}." for method, names in found.items()]
