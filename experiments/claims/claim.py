"""A claim of a paper beside the number computed here, and the rule of its verdict."""

from typing import NamedTuple

import numpy as np

HE2018 = "He et al. 2018"

REPRODUCED = "reproduced"
NOT_REPRODUCED = "not reproduced"
CANNOT_BE_CHECKED = "cannot be checked"

#: Two numbers differ if their distance exceeds this number of Monte Carlo standard errors.
STANDARD_ERRORS = 3.0


class Claim(NamedTuple):
    """One row of the table; `paper_number` is NaN where the paper prints none."""

    paper: str
    claim: str
    paper_number: float
    ours: float
    ours_error: float  # Monte Carlo standard error
    unit: str
    verdict: str
    remark: str


def without_noise(
    paper: str,
    claim: str,
    ours: float,
    unit: str,
    verdict: str,
    remark: str,
    printed: float = np.nan,
) -> Claim:
    """A claim whose number here has no Monte Carlo error."""
    return Claim(paper, claim, printed, ours, np.nan, unit, verdict, remark)


def verdict_below(ours: float, error: float, limit: float) -> str:
    """Whether a number is below a limit by more than `STANDARD_ERRORS` of its errors.

    A claim of an effect that is not seen counts as not reproduced. Without a number or without
    its error nothing is said; infinity ("never") is a number.
    """
    if np.isnan(ours) or not np.isfinite(error):
        return CANNOT_BE_CHECKED
    return REPRODUCED if ours + STANDARD_ERRORS * error < limit else NOT_REPRODUCED


def verdict_equal(ours: float, error: float, expected: float) -> str:
    """Whether a number agrees with the expected one within `STANDARD_ERRORS` of its errors."""
    if not (np.isfinite(ours) and np.isfinite(error)):
        return CANNOT_BE_CHECKED
    agrees = abs(ours - expected) <= STANDARD_ERRORS * error
    return REPRODUCED if agrees else NOT_REPRODUCED


#: Largest relative difference at which a number without noise agrees with a printed one, and with
#: one that was read off a figure or that the paper gives as "about".
PRINTED, READ_OFF = 0.01, 0.10


def verdict_near(ours: float, expected: float, share: float) -> str:
    """Whether a number that has no Monte Carlo error is that of the paper, to a share of it."""
    if np.isnan(ours):
        return NOT_REPRODUCED
    return verdict_if(abs(ours - expected) <= share * abs(expected))


def verdict_if(holds: bool) -> str:
    return REPRODUCED if holds else NOT_REPRODUCED
