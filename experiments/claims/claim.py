"""A claim of a paper beside the number computed here, the rule of its verdict, and the paper.

The TOML of a paper has for each of its `claims` the words, the unit of the number, the number that
is printed, what it rests on (`assumed` unless told), what the number is `below` where the claim is
right, and a remark, names of computed facts in braces; `ranges` has the numbers that are printed
nowhere, `cloud` what is drawn over one of them.
"""

import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest, qmc

Numbers = NDArray[np.float64]
Flags = NDArray[np.bool_]

REPRODUCED = "reproduced"
NOT_REPRODUCED = "not reproduced"
OF_SETTINGS = "holds for {share:.0f} % of settings"
NOT_DECIDED = "not decided"
CANNOT_BE_CHECKED = "cannot be checked"

#: What a row rests on: `printed` numbers, in the paper or in the source that it names; an equation,
#: a unit or a word that is `repaired`, read otherwise than printed or in one way of several; a
#: number that is printed nowhere.
ASSUMED = "assumed"

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


# -------------------------------------------------------------------------------------- the paper

#: The number of settings that are drawn, a power of two as Sobol's sequence asks for.
DRAWS = 64

#: A setting: a number for each name.
Setting = Mapping[str, float]


class Range(NamedTuple):
    """What a number may be: the value used elsewhere here, and the ends between which it is drawn.

    Drawn evenly, or evenly in its logarithm.
    """

    own: float
    low: float
    high: float
    by_ratio: bool = False


def drawn(ranges: Mapping[str, Range]) -> Sequence[Setting]:
    """Our own setting, then `DRAWS` by Sobol's sequence, scrambled with a fixed seed."""
    unit = qmc.Sobol(len(ranges), rng=0).random(DRAWS)
    columns = {name: _within(one, u) for (name, one), u in zip(ranges.items(), unit.T, strict=True)}
    own = {name: one.own for name, one in ranges.items()}
    rows = zip(*columns.values(), strict=True)
    return [own, *(dict(zip(columns, map(float, row), strict=True)) for row in rows)]


def _within(of: Range, share: Numbers) -> Numbers:
    if of.by_ratio:
        return of.low * (of.high / of.low) ** share
    return of.low + (of.high - of.low) * share


def values(settings: Sequence[Setting], name: str) -> Numbers:
    return np.array([setting[name] for setting in settings])


class Paper(NamedTuple):
    name: str
    claims: Mapping[str, Mapping[str, Any]]
    ranges: Mapping[str, Range] = {}
    cloud: Mapping[str, str] = {}

    def settings(self) -> Sequence[Setting]:
        """Our own, and those drawn from the ranges."""
        return drawn(self.ranges)

    def judged(
        self,
        key: str,
        ours: float = np.nan,
        verdict: Verdict = Verdict(CANNOT_BE_CHECKED),  # noqa: B008  (an immutable tuple)
        error: float = np.nan,
        /,
        **facts: Any,
    ) -> Claim:
        """The row of a claim, its facts in its words; `printed` is the number of the paper.

        ValueError where the verdict says more than it rests on: on a number that is printed nowhere
        no claim is reproduced, nor refuted; it holds for a share of the settings, or it is not
        decided.
        """
        said = {"printed": np.nan, "unit": "", "rests_on": ASSUMED, **self.claims[key]}
        told = {"printed": said["printed"], "to_print": TO_PRINT, "read_off": READ_OFF, **facts}
        words, remark = (
            " ".join(said[part].split()).format(**told) for part in ("claim", "remark")
        )
        if said["rests_on"] == ASSUMED and verdict.words in (REPRODUCED, NOT_REPRODUCED):
            raise ValueError(f"{self.name}, {words}: {verdict.words} rests on an assumption")
        numbers = map(float, (told["printed"], ours, error))
        row = (self.name, words, *numbers, said["unit"], *verdict, said["rests_on"], remark)
        return Claim._make(row)

    def below(self, key: str, ours: float, error: float, runs: int, /, **facts: Any) -> Claim:
        """Whether a number of so many runs is `below` what the claim says."""
        verdict = below(ours, error, self.claims[key]["below"], runs)
        return self.judged(key, ours, verdict, error, **facts)

    def near(self, key: str, ours: float, share: float, /, **facts: Any) -> Claim:
        """Whether a number without Monte Carlo error is what is printed, to a share of it."""
        printed = {**self.claims[key], **facts}["printed"]
        return self.judged(key, ours, near(ours, printed, share), **facts)

    def over_settings(self, key: str, ours: Numbers, holds: Flags, /, **facts: Any) -> Claim:
        """The claim with its number at our setting, and whether it holds in each of those drawn."""
        return self.judged(key, float(ours[0]), of_settings(holds[1:]), **facts)


def read_paper(name: str) -> Paper:
    """What NAME.toml says."""
    said = tomllib.loads((Path(__file__).parent / f"{name}.toml").read_text(encoding="utf-8"))
    ranges = {one: Range(**numbers) for one, numbers in said.get("ranges", {}).items()}
    return Paper(said["paper"], said["claims"], ranges, said.get("cloud", {}))
