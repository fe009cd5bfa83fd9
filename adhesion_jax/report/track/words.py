"""The results of a followed log: the table of checkpoints, the summary, the words."""

from collections.abc import Iterable, Mapping

import numpy as np
import pandas as pd

from adhesion_jax.identifiers.base import Status
from adhesion_jax.measured.following import QUANTILE, Followed, as_told
from adhesion_jax.measured.initial_slope import InitialSlope
from adhesion_jax.measured.log import Log
from adhesion_jax.report.measured.words import reasons
from adhesion_jax.report.text import filled, flush_left, with_errors
from adhesion_jax.wording import listed, number, plus_minus

#: Above this share of the initial slope its standard error is said to be large.
_POORLY = 0.1

#: A slope that was given is said to be far from that of the fit above this number of standard
#: errors.
_FAR_OFF = 3.0

#: Errors of the form below this share are not spoken of.
_NO_FORM = 5e-4

#: Most resets whose time is told.
_TOLD = 5


def checkpoint_rows(log: Log, followed: Mapping[str, Followed]) -> pd.DataFrame:
    """One row for each method and checkpoint.

    Columns: identifier, time_s (NaN without time), sample (from 1), mu_max, mu_max_se, mu_max_lo,
    mu_max_hi (95 %), slip_opt, slip_opt_se, status, at_least, reset (whether at this sample),
    resets and skipped (both so far). Where `at_least`, mu_max is the adhesion that was reached,
    without a band, and there is no slip_opt.
    """
    parts = []
    for name, one in followed.items():
        table = as_told(one.estimates)
        half = QUANTILE * table["mu_max_se"]
        parts.append(
            pd.DataFrame(
                {
                    "identifier": name,
                    "time_s": np.nan if log.time is None else log.time[table["sample"]],
                    "sample": 1 + table["sample"],
                    **table[["mu_max", "mu_max_se"]],
                    "mu_max_lo": table["mu_max"] - half,
                    "mu_max_hi": table["mu_max"] + half,
                    **table[["slip_opt", "slip_opt_se"]],
                    "status": [Status(code).name for code in table["status"]],
                    **table[["at_least", "reset", "resets", "skipped"]],
                }
            )
        )
    return pd.concat(parts, ignore_index=True)


def summary_rows(log: Log, followed: Mapping[str, Followed]) -> pd.DataFrame:
    """One row for each method: its last estimate, and what happened on the way.

    Columns: identifier, mu_max, mu_max_se, mu_max_lo, mu_max_hi (95 %), slip_opt, slip_opt_se,
    status, at_least (all after the last sample, as in `checkpoint_rows`), resets, samples (given to
    it), skipped and trusted (shares of these), error_correlation (of consecutive predictions),
    ns_per_sample.
    """
    rows = []
    for name, one in followed.items():
        last, given = as_told(one.estimates.iloc[-1:]).iloc[0], log.used.size
        half = QUANTILE * last["mu_max_se"]
        rows.append(
            {
                "identifier": name,
                **last[["mu_max", "mu_max_se"]],
                "mu_max_lo": last["mu_max"] - half,
                "mu_max_hi": last["mu_max"] + half,
                **last[["slip_opt", "slip_opt_se"]],
                "status": Status(last["status"]).name,
                "at_least": last["at_least"],
                "resets": one.resets,
                "samples": given,
                "skipped": one.skipped / given,
                "trusted": one.trusted / given,
                "error_correlation": one.correlation,
                "ns_per_sample": 1e9 * one.seconds_per_sample,
            }
        )
    return pd.DataFrame(rows)


def printed_summary(summary: pd.DataFrame) -> str:
    """The summary, aligned for a terminal."""
    told = ["mu_max", "mu_max_se", "at_least"]
    cells = pd.DataFrame(
        {
            "method": summary["identifier"],
            "mu_max at the end": [
                f"at least {value:.3f}" if bare else plus_minus(value, error)
                for value, error, bare in summary[told].itertuples(index=False)
            ],
            "slip_opt": with_errors(summary["slip_opt"], summary["slip_opt_se"]),
            "status": summary["status"],
            "resets": summary["resets"].astype(str),
            "skipped": [f"{100 * share:.1f} %" for share in summary["skipped"]],
            "trusted": [f"{100 * share:.1f} %" for share in summary["trusted"]],
            "µs per sample": [f"{time / 1000:.2g}" for time in summary["ns_per_sample"]],
        }
    )
    return flush_left(cells)


def told(log: Log, citation: str, slope: InitialSlope, followed: Mapping[str, Followed]) -> str:
    """In words: the log, the initial slope, what each method ends with, and what to doubt."""
    summary = summary_rows(log, followed)
    paragraphs = [
        ("Log", [*_log(log), citation]),
        ("Initial slope", _slope(slope, log)),
        ("Estimates", _ends(log, followed, summary)),
        ("Not to be trusted", _doubts(slope, followed, summary)),
    ]
    return "\n".join(
        filled(f"{title}: {' '.join(filter(None, sentences))}") for title, sentences in paragraphs
    )


def _log(log: Log) -> Iterable[str]:
    span = ""
    if log.time is not None:
        span = f" over {number(log.time[-1] - log.time[0])} s"
    size = np.abs(log.slip)
    yield (
        f"{log.name} has {log.slip.size:,} samples{span}, with slip up to "
        f"{size.max():.4g}{log.slip_unit}."
    )
    yield from log.sentences
    braking = int(np.sum(log.slip[log.used] < 0))
    if braking:
        yield (
            f"{braking:,} samples whose slip is negative, as in braking, have both signs turned, "
            "since curves are odd."
        )
    still = int(np.sum(log.slip[log.used] == 0))
    if still:
        yield f"{still:,} samples have slip 0, which tells nothing of the curve."


def _slope(slope: InitialSlope, log: Log) -> Iterable[str]:
    per = f" per{log.slip_unit}" if log.slip_unit else ""
    value, error = slope.fitted
    fitted = (
        f"{plus_minus(value, error)}{per}, that of Kiencke's curve fitted to {slope.samples:,} of "
        "these samples, spread evenly over the slips."
    )
    if slope.given:
        yield f"a0 = {number(slope.value)}{per}, as given; the methods take it as exact."
        if abs(slope.value - value) > _FAR_OFF * error:
            yield f"The log speaks for {fitted} Where a0 is wrong, every estimate is biased."
    else:
        yield (
            f"a0 = {fitted} The methods know of later samples this one number; what its standard "
            "error makes of an estimate is in the bands."
        )
        if error > _POORLY * value:
            yield (
                "The samples hardly determine it (standard error "
                f"{100 * error / value:.0f} %): give it by --initial-slope if it is known."
            )
    if slope.fit.status is not Status.TRUSTED:
        yield f"Of that fit: {' '.join(reasons(slope.fit))}"


def _form(slope: InitialSlope) -> str:
    alone, whole = slope.alone, slope.fit.peak
    if not (alone.found and whole.found):
        return (
            "All these methods have Kiencke's curve, which has no peak when it is fitted to the "
            "samples: the bands contain no error of its form."
        )
    if slope.form["mu_max"] < _NO_FORM and slope.form["slip_opt"] < _NO_FORM:
        return "All these methods have Kiencke's curve, which describes the samples."
    return (
        "All these methods have Kiencke's curve. Fitted to the samples it has its peak at "
        f"{float(alone.adhesion):.4f} and slip {float(alone.slip):.3g}; with what it misses of "
        f"them, the peak is at {float(whole.adhesion):.4f} and slip {float(whole.slip):.3g}. The "
        f"bands allow for {100 * slope.form['mu_max']:.1f} % of mu_max by this, and for "
        f"{100 * slope.form['slip_opt']:.0f} % of slip_opt, as a standard error."
    )


def _ends(log: Log, followed: Mapping[str, Followed], summary: pd.DataFrame) -> Iterable[str]:
    for row in summary.to_dict("records"):
        name, status = str(row["identifier"]), Status[row["status"]]
        if row["at_least"]:
            yield (
                f"{name} ends with mu_max at least {row['mu_max']:.3f}: adhesion does not fall in "
                f"the window{_resets(log, followed[name])}; the driver or the brake may limit it."
            )
            continue
        band = (
            f" (95 % band {row['mu_max_lo']:.4f} to {row['mu_max_hi']:.4f})"
            if np.isfinite(row["mu_max_se"])
            else " (without a band)"
        )
        yield f"{name} ends with mu_max {row['mu_max']:.4f}{band}{_resets(log, followed[name])}."
        if status is not Status.TRUSTED:
            yield f"That is not to be trusted: {status.sentence}"
    sure = summary[(summary["status"] == Status.TRUSTED.name) & np.isfinite(summary["mu_max_se"])]
    if len(sure) > 1 and sure["mu_max_lo"].max() > sure["mu_max_hi"].min():
        high, low = sure.loc[sure["mu_max_lo"].idxmax()], sure.loc[sure["mu_max_hi"].idxmin()]
        yield (
            f"{high['identifier']} and {low['identifier']} disagree by more than their bands: at "
            "least one of them is biased, or they remember different stretches of the log."
        )


def _resets(log: Log, one: Followed) -> str:
    if not one.resets:
        return ", without a reset"
    at = one.estimates["sample"][one.estimates["reset"]].to_numpy()[:_TOLD]
    places = [number(log.time[i]) if log.time is not None else str(i + 1) for i in at]
    what = "at time" if log.time is not None else "at sample"
    more = " and later" if one.resets > len(places) else ""
    unit = " s" if log.time is not None else ""
    return (
        f", after {one.resets} reset{'s' if one.resets > 1 else ''} {what} "
        f"{listed(places)}{unit}{more}"
    )


def _doubts(
    slope: InitialSlope, followed: Mapping[str, Followed], summary: pd.DataFrame
) -> Iterable[str]:
    yield _form(slope)
    resets = [name for name, one in followed.items() if one.resets]
    if resets and not slope.given:
        yield (
            f"{listed(resets)} gave up the past, as where the rail has changed: a0 is then that of "
            "all rails together, and where their slopes differ every estimate is biased."
        )
    wide = {name: one.widening for name, one in followed.items() if one.widening > 1.1}
    if wide:
        least, most = min(wide.values()), max(wide.values())
        factor = f"{least:.1f}" if most - least < 0.1 else f"{least:.1f} to {most:.1f}"
        yield (
            "Consecutive errors of prediction are correlated "
            f"({', '.join(f'{name} {followed[name].correlation:.2f}' for name in wide)}): the "
            f"noise makes the bands {factor} times as wide as those of the methods, which take it "
            "as independent."
        )
    yield (
        "A band holds for a rail that has not changed since the last reset or, of methods that "
        "forget, over what they remember, and for a slip without noise."
    )
    seldom = summary[summary["trusted"] < 0.5]
    if len(seldom):
        yield (
            f"{listed(list(seldom['identifier']))} "
            f"{'is' if len(seldom) == 1 else 'are'} trusted after fewer than half of the samples."
        )
