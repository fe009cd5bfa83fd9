"""Which figures moved, beyond what Monte Carlo error and a noisy machine explain.

Accuracy. The two tables come from independent runs, so the difference of two means has the
combined error of both. Where both have the same number of runs the difference is symmetric if
nothing changed, and a mean with few large errors behind it is then no more likely to stray beyond
its own standard error than a normal one: heavy tails cost power, not false alarms. The mean square
is compared in place of its root for the same reason. Shares are compared by Fisher's exact test,
every run counted as one trial: exact near 0 and 1, cautious where a run has several blocks. All
tests are two-sided, and Holm's procedure keeps the probability of any false alarm in the whole
table below `FALSE_ALARM`.

A bias or a coverage that moved is a regression whichever way, since two wrongs may cancel; an RMSE
or a failure share that fell is not.

Speed. The ratio to the peer is held against a fixed factor, `SLOWER`, since its error is not one of
sampling. On two cores that nine other processes fought for, a single turn scattered by 13 %, the
median of five by 6 %: the factor is more than four of the errors of two such medians, and a method
that takes twice as long is three beyond it.
"""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.stats import hypergeom
from scipy.stats import t as student_t

from adhesion_jax.report.rendering import with_errors
from experiments.regression.table import KEYS, SPEED

Array = NDArray[np.float64]

#: Largest probability of a false alarm in the whole table of accuracy.
FALSE_ALARM = 0.005

#: An identifier is slower if its ratio to the peer is below the baseline's divided by this.
SLOWER = 1.5

#: Two figures whose standard errors are zero are the same to this relative difference.
_ROUNDING = 1e-9

#: Figures of which a smaller value is always better.
_LESS_IS_BETTER = ("rmse", "failure_share")

#: Verdicts on a figure; the first three are regressions.
WORSE, MOVED, GONE, BETTER, NEW, SAME = "worse", "moved", "gone", "better", "new", "same"
REGRESSIONS = (WORSE, MOVED, GONE)


def compare(baseline: pd.DataFrame, fresh: pd.DataFrame) -> pd.DataFrame:
    """One row a comparison: keys, statistic, baseline, baseline_se, fresh, fresh_se, p, verdict.

    A figure that only one table has is `new` or `gone`; an identifier that only one has is one row.
    """
    old, new = _figures(baseline), _figures(fresh)
    both = _judged(old.merge(new, on=[*KEYS, "statistic"], suffixes=("_0", "_1")))
    unmatched = [_unmatched(old, new, GONE), _unmatched(new, old, NEW)]
    return pd.concat([both, *unmatched], ignore_index=True)


def suspects(compared: pd.DataFrame) -> tuple[str, ...]:
    """The identifiers that seem slower; they are timed a second time before the verdict."""
    slow = compared[(compared["statistic"] == SPEED) & (compared["verdict"] == WORSE)]
    return tuple(slow["identifier"])


def faster_of(first: pd.DataFrame, again: pd.DataFrame) -> pd.DataFrame:
    """The table with the better of two timings, since other load can only slow a method down."""
    better = first.copy()
    for _, row in again.iterrows():
        place = (better["identifier"] == row["identifier"]) & (better["quantity"] == SPEED)
        if (better.loc[place, "speed"] < row["speed"]).all():
            better.loc[place, ["speed", "speed_spread"]] = [row["speed"], row["speed_spread"]]
    return better


def holm(p: Array, level: float) -> NDArray[np.bool_]:
    """Which hypotheses are rejected at a family-wise level, by Holm's step-down procedure."""
    order = np.argsort(p, kind="stable")
    passed = p[order] <= level / (len(p) - np.arange(len(p)))
    rejected = np.zeros(len(p), dtype=bool)
    rejected[order] = np.logical_and.accumulate(passed)
    return rejected


def p_values(
    statistic: Sequence[str],
    value: Sequence[Array],
    error: Sequence[Array],
    runs: Sequence[Array],
) -> Array:
    """The p of each figure, from values, standard errors and runs of both tables; NaN for speed."""

    def of(pair: Sequence[Array], rows: NDArray[np.bool_]) -> list[Array]:
        return [x[rows] for x in pair]

    p, name = np.full(len(statistic), np.nan), np.asarray(statistic)
    rows = name == "bias"
    p[rows] = mean_p(of(value, rows), of(error, rows), of(runs, rows))
    rows = name == "rmse"
    pairs = list(zip(of(value, rows), of(error, rows), strict=True))
    squares = [x**2 for x, _ in pairs]
    errors = [np.where(x == 0, 0.0, 2 * x * e) for x, e in pairs]
    p[rows] = mean_p(squares, errors, of(runs, rows))
    rows = np.isin(name, ("coverage95", "failure_share"))
    p[rows] = share_p(of(value, rows), of(runs, rows))
    return p


def mean_p(mean: Sequence[Array], error: Sequence[Array], runs: Sequence[Array]) -> Array:
    """Two-sided, of the difference of two independent means with their standard errors."""
    with np.errstate(invalid="ignore"):
        difference = np.abs(mean[0] - mean[1])
        least = _ROUNDING * (np.abs(mean[0]) + np.abs(mean[1]))
        combined = np.maximum(np.hypot(*error), least)
        score = np.where(difference <= least, 0.0, difference / np.where(combined > 0, combined, 1))
    p = 2 * student_t.sf(score, np.maximum(np.minimum(*runs) - 1, 1))
    return _where_finite(p, [m + e for m, e in zip(mean, error, strict=True)])


def share_p(share: Sequence[Array], runs: Sequence[Array]) -> Array:
    """Two-sided (twice the smaller tail) by Fisher's exact test of two shares of runs."""
    counts = [np.rint(s * n) for s, n in zip(share, runs, strict=True)]
    total, of_both = runs[0] + runs[1], counts[0] + counts[1]
    lower = hypergeom.cdf(counts[1], total, of_both, runs[1])
    upper = hypergeom.sf(counts[1] - 1, total, of_both, runs[1])
    return _where_finite(np.minimum(2 * np.minimum(lower, upper), 1.0), share)


def _where_finite(p: Array, figures: Sequence[Array]) -> Array:
    """The p, replaced by 0 if only one of two figures is a number and by 1 if neither is."""
    old, new = (np.isfinite(figure) for figure in figures)
    return np.where(old & new, p, np.where(old == new, 1.0, 0.0))


def _figures(table: pd.DataFrame) -> pd.DataFrame:
    """The table in long form: one row per compared figure, with its error and its runs."""
    parts = []
    accuracy = table[table["quantity"] != SPEED]
    for name in ("bias", "rmse", "coverage95"):
        parts.append(_long(accuracy, name, f"{name}_se"))
    # A failure concerns the whole curve and is the same for all its quantities.
    whole = accuracy.assign(quantity="curve").drop_duplicates(list(KEYS))
    parts.append(_long(whole, "failure_share", "failure_share_se"))
    parts.append(_long(table[table["quantity"] == SPEED], SPEED, "speed_spread"))
    return pd.concat(parts, ignore_index=True)


def _long(table: pd.DataFrame, name: str, error: str) -> pd.DataFrame:
    figures = table[[*KEYS, name, error, "runs"]]
    return figures.set_axis([*KEYS, "value", "se", "runs"], axis=1).assign(statistic=name)


def _judged(both: pd.DataFrame) -> pd.DataFrame:
    value, error, runs = (
        [both[f"{name}_{side}"].to_numpy(dtype=float) for side in (0, 1)]
        for name in ("value", "se", "runs")
    )
    statistic = both["statistic"].to_numpy(dtype=str)
    p = p_values(list(statistic), value, error, runs)
    rows = statistic != SPEED
    moved = np.zeros(len(both), dtype=bool)
    moved[rows] = holm(p[rows], FALSE_ALARM)
    fell = (value[1] < value[0]) | np.isnan(value[0])
    verdict = np.where(moved, MOVED, SAME)
    directed = moved & np.isin(statistic, _LESS_IS_BETTER)
    verdict = np.where(directed, np.where(fell, BETTER, WORSE), verdict)
    verdict = np.where(~rows & (value[1] * SLOWER < value[0]), WORSE, verdict)
    verdict = np.where(~rows & (value[1] > SLOWER * value[0]), BETTER, verdict)
    judged = both[[*KEYS, "statistic"]].copy()
    judged["baseline"], judged["baseline_se"] = value[0], error[0]
    judged["fresh"], judged["fresh_se"] = value[1], error[1]
    judged["p"], judged["verdict"] = p, verdict
    return judged


def _unmatched(side: pd.DataFrame, other: pd.DataFrame, verdict: str) -> pd.DataFrame:
    """Figures that the other table lacks; one row for an identifier that it lacks entirely."""
    names = [*KEYS, "statistic"]
    known = pd.MultiIndex.from_frame(other[names])
    alone = side.loc[~pd.MultiIndex.from_frame(side[names]).isin(known), names]
    unknown = ~alone["identifier"].isin(other["identifier"])
    whole = alone[unknown].drop_duplicates("identifier")
    whole = whole.assign(rail="", quantity="", statistic="")
    return pd.concat([whole, alone[~unknown]], ignore_index=True).assign(verdict=verdict)


#: Verdicts on an identifier that only one of the two tables has.
_WHOLE = {
    NEW: "is not in the baseline; --update adds it.",
    GONE: "is in the baseline but is no identifier any more; --update removes it.",
}


def moved_text(compared: pd.DataFrame) -> str:
    """An aligned table of all that is not the same, regressions first; then the count."""
    moved = compared[compared["verdict"] != SAME]
    bad = moved["verdict"].isin(REGRESSIONS)
    count = f"{bad.sum()} of {len(compared)} figures got worse."
    if not len(moved):
        return count
    moved = pd.concat([moved[bad], moved[~bad]])
    lines = pd.DataFrame(
        {
            **{name: moved[name] for name in ("verdict", "identifier", "scenario", "rail")},
            **{name: moved[name] for name in ("quantity", "statistic")},
            "baseline": with_errors(moved["baseline"], moved["baseline_se"]),
            "fresh": with_errors(moved["fresh"], moved["fresh_se"]),
            "p": [f"{p:.1g}" if np.isfinite(p) else "" for p in moved["p"]],
        }
    )
    sentences = [
        f"{name} {_WHOLE[verdict]}"
        for name, verdict, statistic in zip(
            moved["identifier"], moved["verdict"], moved["statistic"], strict=True
        )
        if statistic == ""
    ]
    return "\n".join([lines.to_string(index=False), "", *sentences, count])
