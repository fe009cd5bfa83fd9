"""The results of a followed log: the table of checkpoints, the summary, the words."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from adhesion_jax.identifiers.base import Status
from adhesion_jax.measured.following import QUANTILE, Followed, as_told
from adhesion_jax.measured.log import InitialSlope, Log
from adhesion_jax.report.measured.words import reasons
from adhesion_jax.report.rendering import flush_left, text_of, with_errors
from adhesion_jax.wording import number, plus_minus

#: Above this share of the initial slope its standard error is said to be large.
_POORLY = 0.1

#: A slope that was given is said to be far from that of the fit above this number of standard
#: errors.
_FAR_OFF = 3.0

#: Errors of the form below this share are not spoken of.
_NO_FORM = 5e-4

#: Columns of a checkpoint that the summary has of the last one.
_AT_THE_END = (
    *("identifier", "mu_max", "mu_max_se", "mu_max_lo", "mu_max_hi", "slip_opt", "slip_opt_se"),
    *("status", "at_least"),
)

#: Bands that noise makes this much wider than those of the methods are spoken of.
_WIDER = 1.1

#: A method lags behind a rail if its errors are alike over this many times as many samples as those
#: of another one.
_LAGS = 4.0

#: Most resets whose time is told.
_TOLD = 5


def checkpoint_rows(log: Log, followed: Mapping[str, Followed]) -> pd.DataFrame:
    """One row for each method and checkpoint.

    Columns: identifier, time_s (NaN without time), sample (from 1), mu_max, mu_max_se, mu_max_lo,
    mu_max_hi (95 %), slip_opt, slip_opt_se, status, at_least, reset (whether at this sample),
    resets and skipped (both so far). Where `at_least`, mu_max is the adhesion that was reached
    (NaN where too few samples tell), without a band, and there is no slip_opt.
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
    last = checkpoint_rows(log, followed).drop_duplicates("identifier", keep="last")
    methods, given = followed.values(), log.used.size
    return (
        last[list(_AT_THE_END)]
        .assign(
            resets=[one.resets for one in methods],
            samples=given,
            skipped=[one.skipped / given for one in methods],
            trusted=[one.trusted / given for one in methods],
            error_correlation=[one.correlation for one in methods],
            ns_per_sample=[1e9 * one.seconds_per_sample for one in methods],
        )
        .reset_index(drop=True)
    )


def printed_summary(summary: pd.DataFrame) -> str:
    """The summary, aligned for a terminal."""
    told = ["mu_max", "mu_max_se", "at_least"]
    cells = pd.DataFrame(
        {
            "method": summary["identifier"],
            "mu_max at the end": [
                _at_least(value) if bare else plus_minus(value, error)
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


def _at_least(value: float) -> str:
    return f"at least {value:.3f}" if np.isfinite(value) else "unknown"


def told(log: Log, citation: str, slope: InitialSlope, followed: Mapping[str, Followed]) -> str:
    """In words: the log, the initial slope, what each method ends with, and what to doubt."""
    summary, used = summary_rows(log, followed), log.slip[log.used]
    status = summary["status"].map(Status.__getitem__)
    sure = summary[(status == Status.TRUSTED) & np.isfinite(summary["mu_max_se"])]
    disagree: Sequence[str] = ()
    least = min(map(_memory, followed.values()))
    if len(sure) > 1 and sure["mu_max_lo"].max() > sure["mu_max_hi"].min():
        apart = sure["mu_max_lo"].idxmax(), sure["mu_max_hi"].idxmin()
        disagree = list(sure["identifier"].loc[[*apart]])
    return text_of(
        "track.txt",
        log=log,
        citation=citation,
        slope=slope,
        largest_slip=np.abs(log.slip).max(),
        braking=int(np.sum(used < 0)),
        still=int(np.sum(used == 0)),
        doubts=[] if slope.fit.status is Status.TRUSTED else reasons(slope.fit),
        ends=list(zip(summary.to_dict("records"), followed.values(), status, strict=True)),
        places=lambda one: _places(log, one),
        disagree=disagree,
        reset=[name for name, one in followed.items() if one.resets],
        wide={name: one for name, one in followed.items() if one.widening > _WIDER},
        behind=[name for name, one in followed.items() if _memory(one) > _LAGS * least],
        seldom=list(summary["identifier"][summary["trusted"] < 0.5]),
        trusted=Status.TRUSTED,
        far_off=_FAR_OFF,
        poorly=_POORLY,
        no_form=_NO_FORM,
    )


def _memory(one: Followed) -> float:
    """The number of samples over which errors of prediction are alike, of a first-order process."""
    return (1 + one.correlation) / max(1 - one.correlation, 1e-6)


def _places(log: Log, one: Followed) -> list[str]:
    """The times of the first resets or, where there is no time, the numbers of their samples."""
    at = one.estimates["sample"][one.estimates["reset"]].to_numpy()[:_TOLD]
    return [str(i + 1) if log.time is None else number(log.time[i]) for i in at]
