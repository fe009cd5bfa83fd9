"""The table of a board: a row a method and family of rails, from the figures of its runs."""

import tomllib
from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from adhesion_jax.campaign.traction import WHOLE
from adhesion_jax.errors import InputError
from adhesion_jax.leaderboard.runs import standard_error
from adhesion_jax.leaderboard.terms import OPTIMA, Versions
from adhesion_jax.metrics.closed_loop import PRICES
from adhesion_jax.wording import listed

#: Utilities are told in MJ.
_MEGA = 1e6

#: The figures of a run of which a table has the mean and its standard error.
MEANS = (
    "utilisation",
    "pull",
    "pull_share",
    *(f"utility_{price}" for price in PRICES),
    "slip_energy_share",
    "torque_variation",
    "jerk_rms",
)

#: The price at which methods are ranked, and what else a method is better by: less of both.
RANKED_BY, COSTS = "utility_1", ("torque_variation", "slip_energy_share")

#: Unit and meaning of each column.
COLUMNS: Mapping[str, tuple[str, str]] = {
    name: (unit, meaning)
    for name, (unit, meaning) in tomllib.loads(
        Path(__file__).with_name("columns.toml").read_text("utf-8")
    ).items()
}

#: The columns that hold words, versions among them, which may be all digits.
WORDS = ("rails", "method", "remark", "dominated_by", "tuned", "plant", "rails_version", "metrics")


class Known(NamedTuple):
    """What is known of a method beside its runs."""

    told: bool  # whether it is told what no train can measure
    promised: float
    promised_se: float
    tuned: str  # its numbers, in words
    microseconds: float
    state_bytes: int


def table_of(
    segments: pd.DataFrame,
    known: Mapping[str, Known],
    versions: Mapping[str, Versions],
    tuned_on: str,
) -> pd.DataFrame:
    """A row for each method on each family; `versions` are by family."""
    rows = [
        _row(rails, method, of_rails[of_rails["method"] == method], one, versions[rails], tuned_on)
        for rails in versions
        if len(of_rails := segments[segments["rails"] == rails])
        for method, one in known.items()
    ]
    return ranked(_with_differences(pd.DataFrame(rows), segments))


def _row(
    rails: str, method: str, part: pd.DataFrame, known: Known, versions: Versions, tuned_on: str
) -> dict[str, Any]:
    runs = part[part["segment"] == WHOLE]
    whole = runs[np.isfinite(runs["utilisation"])]
    failed = len(runs) - len(whole)
    numbers, sound = (pd.MultiIndex.from_frame(of[["seed", "run"]]) for of in (part, whole))
    segments = (part["segment"] != WHOLE) & numbers.isin(sound) & np.isfinite(part["never95"])
    of_segments = part[segments]
    row: dict[str, Any] = {
        "rails": rails,
        "method": method,
        "remark": "told what no train can measure" if known.told else "",
        "runs": len(runs),
        "failed": failed,
    }
    if failed:
        row["remark"] = f"no number in {failed} of {len(runs)} runs"
    for name in MEANS:
        values = whole[name].to_numpy() / (_MEGA if name.startswith("utility") else 1.0)
        row[name] = values.mean() if len(values) else np.nan
        row[f"{name}_se"] = standard_error(values)
    judged, error = row["utilisation"], row["utilisation_se"]
    here = 1.0 if rails == tuned_on else np.nan
    t95 = of_segments["t95"].fillna(np.inf).to_numpy()
    return {
        **row,
        "worst": whole["utilisation"].min(),
        "seeds_apart": _apart(whole),
        "promised": known.promised,
        "promised_se": known.promised_se,
        "promised_z": here * (known.promised - judged) / np.hypot(known.promised_se, error),
        "never95": of_segments["never95"].mean(),
        "t95_median": _quantile(t95, 0.5),
        "t95_p90": _quantile(t95, 0.9),
        "axle_torque_median": _quantile(whole["axle_torque_over_static"].to_numpy(), 0.5),
        "axle_torque_p95": _quantile(whole["axle_torque_over_static"].to_numpy(), 0.95),
        "microseconds": known.microseconds,
        "state_bytes": known.state_bytes,
        "tuned": known.tuned,
        "plant": versions.plant,
        "rails_version": versions.rails,
        "metrics": versions.metrics,
    }


def _quantile(values: np.ndarray, share: float) -> float:
    """The smallest value within which this share of all lies; NaN if that is infinite."""
    if not len(values):
        return float("nan")
    found = float(np.quantile(values, share, method="inverted_cdf"))
    return found if np.isfinite(found) else float("nan")


def _apart(whole: pd.DataFrame) -> float:
    """The largest difference between the utilisations of two seeds, in its standard errors."""
    of_seeds = [part["utilisation"].to_numpy() for _, part in whole.groupby("seed")]
    pairs = [(a, b) for place, a in enumerate(of_seeds) for b in of_seeds[:place]]
    apart = [
        abs(a.mean() - b.mean()) / np.hypot(standard_error(a), standard_error(b)) for a, b in pairs
    ]
    return max(apart, default=float("nan"))


def _with_differences(table: pd.DataFrame, segments: pd.DataFrame) -> pd.DataFrame:
    """With the differences to the best on each family and the shares of the optima, run by run."""
    whole = segments[segments["segment"] == WHOLE]
    parts = []
    for rails, part in table.groupby("rails", sort=False):
        here = whole[whole["rails"] == rails]
        fair = part[part["remark"] == ""]
        best = "" if fair.empty else top(fair, "utilisation")
        compared = {
            "difference": ("utilisation", best, False),
            **{f"utility_{p}_share": (f"utility_{p}", one, True) for p, one in OPTIMA.items()},
        }
        for column, (name, other, share) in compared.items():
            pairs = [_compared(here, name, method, other, share) for method in part["method"]]
            means, errors = np.transpose(pairs)
            part = part.assign(**{column: means, f"{column}_se": errors})
        parts.append(part)
    return pd.concat(parts, ignore_index=True)


def _compared(
    whole: pd.DataFrame, name: str, one: str, other: str, share: bool
) -> tuple[float, float]:
    """The mean difference of a figure of two methods, or the ratio of its means, with its error.

    Of the runs in which both have the figure; the error of the ratio is that to the first order.
    """
    keyed = [
        whole.loc[whole["method"] == method].set_index(["seed", "run"])[name]
        for method in (one, other)
    ]
    both = pd.concat(keyed, axis=1, join="inner").to_numpy()
    both = both[np.isfinite(both).all(axis=1)]
    if not len(both):
        return np.nan, np.nan
    own, theirs = both.T
    if not share:
        return float(np.mean(own - theirs)), standard_error(own - theirs)
    ratio = float(own.mean() / theirs.mean())
    return ratio, standard_error(own - ratio * theirs) / abs(float(theirs.mean()))


def with_rows(table: pd.DataFrame, other: pd.DataFrame) -> pd.DataFrame:
    """With the rows of another board for what is not in this one: of other versions, unranked."""
    here = table.groupby("rails", sort=False)[["plant", "rails_version", "metrics"]].first()
    known = set(zip(table["rails"], table["method"], strict=True))
    rows = []
    for _, row in other.iterrows():
        if (row["rails"], row["method"]) in known or row["rails"] not in here.index:
            continue
        same = (row[here.columns] == here.loc[row["rails"]]).all()
        remark = row["remark"] if same else "of another version"
        # Its differences are from the best of its own board.
        rows.append({**row, "remark": remark, "difference": np.nan, "difference_se": np.nan})
    if not rows:
        return table
    order = {name: place for place, name in enumerate(here.index)}
    joined = pd.concat([table, pd.DataFrame(rows)], ignore_index=True)
    joined = joined.sort_values("rails", key=lambda names: names.map(order), kind="stable")
    return ranked(joined.reset_index(drop=True))


def board_of(board: str | PathLike[str]) -> pd.DataFrame:
    """The rows of another board; InputError where the file is none."""
    try:
        found = pd.read_csv(
            board, keep_default_na=False, na_values=[""], dtype=dict.fromkeys(WORDS, str)
        )
    except OSError as error:
        reason = error.strerror
        raise InputError(f"{board} cannot be read ({reason}); name a leaderboard.csv.") from None
    except ValueError:
        raise InputError(f"{board} is no table; name a leaderboard.csv.") from None
    lacks = [name for name in COLUMNS if name not in found]
    if lacks:
        raise InputError(f"{board} is no leaderboard.csv: it lacks {listed(lacks)}.")
    return found.assign(**{name: found[name].fillna("") for name in WORDS})


def ranked(table: pd.DataFrame) -> pd.DataFrame:
    """With the places of the methods without a remark, and who dominates whom; in that order."""
    parts = []
    for _, part in table.groupby("rails", sort=False):
        ranked = part["remark"] == ""
        fair = part[ranked]
        rank = fair[RANKED_BY].rank(ascending=False, method="min")
        dominators = [_dominator(row, fair) for _, row in part.iterrows()]
        part = part.assign(
            rank=rank.reindex(part.index).astype("Int64"),
            dominated_by=np.where(ranked, dominators, ""),
        )
        parts.append(part.sort_values("rank", kind="stable", na_position="last"))
    found = pd.concat(parts, ignore_index=True)
    names = [name for column in COLUMNS for name in (column, f"{column}_se") if name in found]
    return found[names]


def _dominator(row: pd.Series, fair: pd.DataFrame) -> str:
    """The ranked method with the largest utility of those that are better in every respect."""
    better = fair[RANKED_BY] > row[RANKED_BY]
    for cost in COSTS:
        better &= fair[cost] < row[cost]
    found = fair[better]
    return "" if found.empty else top(found, RANKED_BY)


def top(rows: pd.DataFrame, column: str, least: bool = False) -> str:
    """The method with the largest value in a column, or with the least."""
    values = rows[column].to_numpy(dtype=float)
    place = np.nanargmin(values) if least else np.nanargmax(values)
    return str(rows["method"].iloc[int(place)])
