"""Shares of the sets of a study in which something is so, with their intervals."""

from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.stats import binomtest

from experiments.campaigns.plantable import PLANTABLE
from experiments.discovery_study.random_effect import ACTS_ON
from experiments.discovery_study.tasks import AUTOCORRELATIONS

#: An effect is well removed if at least `REMOVED` of the removable squared error is removed, and
#: missed if less than `MISSED` is.
REMOVED, MISSED = 0.9, 0.1


class _Group(NamedTuple):
    """Sets of one kind, and what is counted among them."""

    part: str
    group: str
    visible: float  # wanted, in sigma; NaN where none was
    hits: Mapping[str, pd.Series]  # by quantity


def rates(sets: pd.DataFrame) -> pd.DataFrame:
    """Shares with their intervals: part, group, visible, quantity, count, hits, rate, low, high.

    The intervals are those of 95 % by Clopper and Pearson 1934; a share of no sets is NaN.
    """
    rows = []
    parts = {part: sets[sets["part"] == part] for part in set(sets["part"])}
    for part, groups in _GROUPS.items():
        for group in groups(parts[part]) if part in parts else ():
            for quantity, hits in group.hits.items():
                count, right = len(hits), int(hits.sum())
                share = (np.nan,) * 3
                if count:
                    interval = binomtest(right, count).proportion_ci(method="exact")
                    share = (right / count, interval.low, interval.high)
                rows.append((*group[:3], quantity, count, right, *share))
    columns = [*_Group._fields[:3], "quantity", "count", "hits", "rate", "low", "high"]
    return pd.DataFrame(rows, columns=columns)


def _nulls(nulls: pd.DataFrame) -> Iterator[_Group]:
    claimed = nulls["claims"] > 0
    yield _Group("nothing", "all", np.nan, {"claimed": claimed})
    slow = ~nulls["autocorrelation"].isin(AUTOCORRELATIONS)
    groups = nulls.assign(autocorrelation=nulls["autocorrelation"].astype(str).mask(slow, "slow"))
    for by in ("base", "design", "autocorrelation", "run_scatter"):
        for value in sorted(set(groups[by])):
            own = claimed[groups[by] == value]
            yield _Group("nothing", f"{by} {value}", np.nan, {"claimed": own})


def _strengths(chosen: pd.DataFrame) -> Iterator[_Group]:
    # An effect that cannot reach the wanted misfit is not counted at that strength.
    reached = chosen[~(chosen["visible"] < 0.8 * chosen["wanted"])]
    for name, of_effect in reached.groupby("planted", sort=False):
        for wanted, same in of_effect.groupby(of_effect["wanted"].fillna(-1.0)):
            level = float(wanted) if wanted >= 0 else np.nan
            quantities = ("detected", "first_right", "in_class", "extra")
            part = same["part"].iloc[0]
            yield _Group(part, str(name), level, {one: same[one] for one in quantities})


def _pairs(pairs: pd.DataFrame) -> Iterator[_Group]:
    columns = {"both_named": "all_named", "one_named": "in_class", "extra": "extra"}
    yield _Group("pair", "all", np.nan, {name: pairs[one] for name, one in columns.items()})


def _randoms(sets: pd.DataFrame) -> Iterator[_Group]:
    for group, same in random_groups(sets).items():
        removed = same["removed"].dropna()
        hits = {name: same[name] for name in ("detected", "all_named", "in_class", "extra")}
        hits |= {"removed_90": removed >= REMOVED, "missed": removed < MISSED}
        yield _Group("random", group, np.nan, hits)


def _logs(logs: pd.DataFrame) -> Iterator[_Group]:
    """Logs with nothing hidden, by kind of log; logs with an effect, by effect over all kinds."""
    null = logs["planted"] == "nothing"
    for kind, same in logs[null].groupby("form", sort=False):
        yield _Group("log", f"nothing: {kind}", np.nan, {"claimed": same["detected"]})
    for planted, same in logs[~null].groupby("planted", sort=False):
        either = same["all_named"] | same["doubted"]
        hits = {"named": same["all_named"], "named_or_doubted": either, "extra": same["extra"]}
        yield _Group("log", str(planted), np.nan, hits)


_GROUPS: Mapping[str, Callable[[pd.DataFrame], Iterator[_Group]]] = {
    "nothing": _nulls,
    "power": _strengths,
    "confusion": _strengths,
    "pair": _pairs,
    "random": _randoms,
    "log": _logs,
}


def random_groups(sets: pd.DataFrame) -> Mapping[str, pd.DataFrame]:
    """The sets with a random effect: all, by what it acts on, by the number of its columns."""
    chosen = sets[sets["part"] == "random"]
    if not len(chosen):
        return {}
    several = chosen["rests_on"].str.contains("*", regex=False)
    return {
        "all": chosen,
        **{name: chosen[chosen["acts_on"] == name] for name in ACTS_ON},
        "one column": chosen[~several],
        "two columns": chosen[several],
    }


def shares(sets: pd.DataFrame) -> pd.DataFrame:
    """Quantiles of the share of the removable squared error that was removed, by group."""
    return pd.DataFrame(
        [
            {
                "group": group,
                "sets": int(same["removed"].notna().sum()),
                "median": same["removed"].median(),
                "lower_quartile": same["removed"].quantile(0.25),
                "lowest_decile": same["removed"].quantile(0.1),
            }
            for group, same in random_groups(sets).items()
        ]
    )


def confusion(sets: pd.DataFrame) -> pd.DataFrame:
    """Counts of sets: planted effect (rows) by the first name that was reported (columns)."""
    chosen = sets[sets["part"] == "confusion"]
    counts = pd.crosstab(chosen["planted"], chosen["first"])
    rows = [name for name in PLANTABLE if name in counts.index]
    others = sorted(name for name in counts.columns if name not in rows and name != "nothing")
    columns = [name for name in (*rows, *others, "nothing") if name in {*counts, *rows, "nothing"}]
    return counts.reindex(index=rows, columns=columns, fill_value=0)
