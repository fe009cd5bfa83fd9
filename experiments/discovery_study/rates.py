"""Shares of the sets of a study in which something is so, with their intervals."""

from collections.abc import Iterator, Mapping
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


class _Hits(NamedTuple):
    """Which sets of a group have a quantity."""

    part: str
    group: str
    visible: float  # wanted, in sigma; NaN where none was
    quantity: str
    hits: pd.Series


def rates(sets: pd.DataFrame) -> pd.DataFrame:
    """Shares with their intervals: part, group, visible, quantity, count, hits, rate, low, high.

    The intervals are those of 95 % by Clopper and Pearson 1934; a share of no sets is NaN.
    """
    rows = []
    for of_part in (_null_hits, _strength_hits, _pair_hits, _random_hits, _log_hits):
        for *names, hits in of_part(sets):
            count, right = len(hits), int(hits.sum())
            share = (np.nan,) * 3
            if count:
                interval = binomtest(right, count).proportion_ci(method="exact")
                share = (right / count, interval.low, interval.high)
            rows.append((*names, count, right, *share))
    columns = [*_Hits._fields[:-1], "count", "hits", "rate", "low", "high"]
    return pd.DataFrame(rows, columns=columns)


def _null_hits(sets: pd.DataFrame) -> Iterator[_Hits]:
    nulls = sets[sets["part"] == "nothing"]
    if not len(nulls):
        return
    claimed = nulls["claims"] > 0
    yield _Hits("nothing", "all", np.nan, "claimed", claimed)
    slow = ~nulls["autocorrelation"].isin(AUTOCORRELATIONS)
    groups = nulls.assign(autocorrelation=nulls["autocorrelation"].astype(str).mask(slow, "slow"))
    for by in ("base", "design", "autocorrelation", "run_scatter"):
        for value in sorted(set(groups[by])):
            own = claimed[groups[by] == value]
            yield _Hits("nothing", f"{by} {value}", np.nan, "claimed", own)


def _strength_hits(sets: pd.DataFrame) -> Iterator[_Hits]:
    for part in ("power", "confusion"):
        # An effect that cannot reach the wanted misfit is not counted at that strength.
        reached = ~(sets["visible"] < 0.8 * sets["wanted"])
        chosen = sets[(sets["part"] == part) & reached]
        keys = chosen["wanted"].fillna(-1.0)
        for name in dict.fromkeys(chosen["planted"]):
            for level in sorted(set(keys[chosen["planted"] == name])):
                same = chosen[(chosen["planted"] == name) & (keys == level)]
                shown = float(level) if level >= 0 else np.nan
                for quantity in ("detected", "first_right", "in_class", "extra"):
                    yield _Hits(part, str(name), shown, quantity, same[quantity])


def _pair_hits(sets: pd.DataFrame) -> Iterator[_Hits]:
    pairs = sets[sets["part"] == "pair"]
    if not len(pairs):
        return
    for quantity, column in (("both_named", "all_named"), ("one_named", "in_class")):
        yield _Hits("pair", "all", np.nan, quantity, pairs[column])
    yield _Hits("pair", "all", np.nan, "extra", pairs["extra"])


def _random_hits(sets: pd.DataFrame) -> Iterator[_Hits]:
    for group, same in random_groups(sets).items():
        removed = same["removed"].dropna()
        for quantity, hits in {
            **{name: same[name] for name in ("detected", "all_named", "in_class", "extra")},
            "removed_90": removed >= REMOVED,
            "missed": removed < MISSED,
        }.items():
            yield _Hits("random", group, np.nan, quantity, hits)


def _log_hits(sets: pd.DataFrame) -> Iterator[_Hits]:
    """Logs with nothing hidden, by kind of log; logs with an effect, by effect over all kinds."""
    logs = sets[sets["part"] == "log"]
    null = logs["planted"] == "nothing"
    for kind, same in logs[null].groupby("form", sort=False):
        yield _Hits("log", f"nothing: {kind}", np.nan, "claimed", same["detected"])
    for planted, same in logs[~null].groupby("planted", sort=False):
        said = {
            "named": same["all_named"],
            "named_or_doubted": same["all_named"] | same["doubted"],
            "extra": same["extra"],
        }
        for quantity, hits in said.items():
            yield _Hits("log", str(planted), np.nan, quantity, hits)


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
