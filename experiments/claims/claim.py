"""A claim of a paper beside the number computed here, and the rule of its verdict."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest

Numbers = NDArray[np.float64]
Flags = NDArray[np.bool_]

REPRODUCED = "reproduced"
NOT_REPRODUCED = "not reproduced"
OF_SETTINGS = "holds for {share:.0f} % of settings"
NOT_DECIDED = "not decided"
CANNOT_BE_CHECKED = "cannot be checked"

#: What a row rests on: numbers that are printed, in the paper or in the source that it names; an
#: equation, a unit or a word that is read otherwise than printed, or in one way of several; a
#: number that is printed nowhere.
PRINTED, REPAIRED, ASSUMED = "printed", "repaired", "assumed"

#: Two numbers differ if their distance exceeds this number of Monte Carlo standard errors.
STANDARD_ERRORS = 3.0

#: Largest relative difference at which a number without noise agrees with a printed one, and with
#: one that was read off a figure or that the paper gives as "about".
TO_PRINT, READ_OFF = 0.01, 0.10


class Verdict(NamedTuple):
    """Words, the share of settings in per cent with its 95 % interval, and the runs that decide."""

    words: str
    share: float = np.nan
    share_low: float = np.nan
    share_high: float = np.nan
    deciding_runs: float = np.nan  # infinite where the number is the limit itself


class Claim(NamedTuple):
    """One row of the table; a number that there is none of is NaN, and is left empty."""

    paper: str
    claim: str
    paper_number: float
    ours: float
    ours_error: float  # Monte Carlo standard error
    unit: str
    verdict: str
    share: float
    share_low: float
    share_high: float
    deciding_runs: float
    rests_on: str
    remark: str


def below(ours: float, error: float, limit: float, runs: int) -> Verdict:
    """Whether a number is below a limit, by more than `STANDARD_ERRORS` of its errors.

    Where it is neither below nor above by that much, it is not decided: the error of n runs falls
    as 1/sqrt(n), which gives the number of runs that would decide if the difference stays as it
    is. Without a number or without its error nothing is said; infinity ("never") is a number.
    """
    if np.isnan(ours) or not np.isfinite(error):
        return Verdict(CANNOT_BE_CHECKED)
    if ours + STANDARD_ERRORS * error < limit:
        return Verdict(REPRODUCED)
    if ours - STANDARD_ERRORS * error >= limit:
        return Verdict(NOT_REPRODUCED)
    gap = abs(ours - limit)
    needed = runs * (STANDARD_ERRORS * error / gap) ** 2 if gap else np.inf
    # Rounding aside: 100 (3 .1/.2)^2 is 225 and not a little more.
    return Verdict(NOT_DECIDED, deciding_runs=float(np.ceil(np.round(needed, 6))))


def equal(ours: float, error: float, expected: float) -> Verdict:
    """Whether a number agrees with the expected one within `STANDARD_ERRORS` of its errors."""
    if not (np.isfinite(ours) and np.isfinite(error)):
        return Verdict(CANNOT_BE_CHECKED)
    return holding(abs(ours - expected) <= STANDARD_ERRORS * error)


def near(ours: float, expected: float, share: float) -> Verdict:
    """Whether a number that has no Monte Carlo error is that of the paper, to a share of it."""
    return holding(bool(is_near(np.array(ours), expected, share)))


def is_near(ours: Numbers, expected: float, share: float) -> Flags:
    return np.asarray(np.abs(ours - expected) <= share * abs(expected))


def holding(holds: bool) -> Verdict:
    return Verdict(REPRODUCED if holds else NOT_REPRODUCED)


def of_settings(holds: Flags) -> Verdict:
    """The share of the drawn settings for which a claim holds, with the interval of Wilson 1927."""
    found = binomtest(int(np.sum(holds)), len(holds))
    low, high = found.proportion_ci(method="wilson")
    percent = 100 * np.array([found.statistic, low, high])
    return Verdict(OF_SETTINGS.format(share=percent[0]), *map(float, percent))
