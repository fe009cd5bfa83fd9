"""Shares of the sets of a study in which something is so, with their intervals."""

from collections.abc import Callable, Iterator, Mapping

import numpy as np
import pandas as pd

from experiments.campaigns.plantable import PLANTABLE
from experiments.discovery_study.random_effect import ACTS_ON
from experiments.discovery_study.tasks import AUTOCORRELATIONS
from experiments.study import Group, rates_of, spread

#: An effect is well removed if at least `REMOVED` of the removable squared error is removed, and
#: missed if less than `MISSED` is.
REMOVED, MISSED = 0.9, 0.1


def rates(sets: pd.DataFrame) -> pd.DataFrame:
    """Shares of the groups by part, group and the misfit that is wanted, in sigma; NaN where none.

    Their 95 % intervals are those of Clopper and Pearson 1934.
    """
    parts = {part: sets[sets["part"] == part] for part in _GROUPS}
    groups = (group for part, own in parts.items() if len(own) for group in _GROUPS[part](own))
    return rates_of(groups, ("part", "group", "visible"), "exact")


def _group(part: str, group: str, hits: Mapping[str, pd.Series], visible: float = np.nan) -> Group:
    """Sets of one kind, and what is so of each of them, by quantity."""
    return (part, group, visible), {name: (int(of.sum()), len(of)) for name, of in hits.items()}


def _nulls(nulls: pd.DataFrame) -> Iterator[Group]:
    claimed = nulls["claims"] > 0
    yield _group("nothing", "all", {"claimed": claimed})
    slow = ~nulls["autocorrelation"].isin(AUTOCORRELATIONS)
    groups = nulls.assign(autocorrelation=nulls["autocorrelation"].astype(str).mask(slow, "slow"))
    for by in ("base", "design", "autocorrelation", "run_scatter"):
        for value in sorted(set(groups[by])):
            own = claimed[groups[by] == value]
            yield _group("nothing", f"{by} {value}", {"claimed": own})


def _strengths(chosen: pd.DataFrame) -> Iterator[Group]:
    # An effect that cannot reach the wanted misfit is not counted at that strength.
    reached = chosen[~(chosen["visible"] < 0.8 * chosen["wanted"])]
    for name, of_effect in reached.groupby("planted", sort=False):
        for wanted, same in of_effect.groupby(of_effect["wanted"].fillna(-1.0)):
            level = float(wanted) if wanted >= 0 else np.nan
            quantities = ("detected", "first_right", "in_class", "extra")
            part = same["part"].iloc[0]
            yield _group(part, str(name), {one: same[one] for one in quantities}, level)


def _pairs(pairs: pd.DataFrame) -> Iterator[Group]:
    columns = {"both_named": "all_named", "one_named": "in_class", "extra": "extra"}
    yield _group("pair", "all", {name: pairs[one] for name, one in columns.items()})


def _randoms(sets: pd.DataFrame) -> Iterator[Group]:
    for group, same in random_groups(sets).items():
        removed = same["removed"].dropna()
        hits = {name: same[name] for name in ("detected", "all_named", "in_class", "extra")}
        hits |= {"removed_90": removed >= REMOVED, "missed": removed < MISSED}
        yield _group("random", group, hits)


def _logs(logs: pd.DataFrame) -> Iterator[Group]:
    """Logs with nothing hidden, by kind of log; logs with an effect, by effect over all kinds."""
    null = logs["planted"] == "nothing"
    for kind, same in logs[null].groupby("form", sort=False):
        yield _group("log", f"nothing: {kind}", {"claimed": same["detected"]})
    for planted, same in logs[~null].groupby("planted", sort=False):
        either = same["all_named"] | same["doubted"]
        hits = {"named": same["all_named"], "named_or_doubted": either, "extra": same["extra"]}
        yield _group("log", str(planted), hits)


_GROUPS: Mapping[str, Callable[[pd.DataFrame], Iterator[Group]]] = {
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
    rows = [(group, *spread(same["removed"])) for group, same in random_groups(sets).items()]
    return pd.DataFrame(
        rows, columns=["group", "sets", "median", "lower_quartile", "lowest_decile"]
    )


def confusion(sets: pd.DataFrame) -> pd.DataFrame:
    """Counts of sets: planted effect (rows) by the first name that was reported (columns)."""
    chosen = sets[sets["part"] == "confusion"]
    counts = pd.crosstab(chosen["planted"], chosen["first"])
    rows = [name for name in PLANTABLE if name in counts.index]
    others = sorted(name for name in counts.columns if name not in rows and name != "nothing")
    columns = [name for name in (*rows, *others, "nothing") if name in {*counts, *rows, "nothing"}]
    return counts.reindex(index=rows, columns=columns, fill_value=0)
