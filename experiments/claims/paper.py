"""A paper: its claims and the numbers that it leaves open, as the TOML of its name tells them.

There `claims` has for each claim its words, the unit of its number, the number that is printed,
what it rests on (`assumed` unless told), what the number is `below` where the claim is right, and
a remark, names of computed facts in braces; `ranges` has the numbers that are printed nowhere.
"""

import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import qmc

from experiments.claims.claim import (
    ASSUMED,
    CANNOT_BE_CHECKED,
    NOT_REPRODUCED,
    READ_OFF,
    REPRODUCED,
    TO_PRINT,
    Claim,
    Flags,
    Numbers,
    Verdict,
    below,
    near,
    of_settings,
)

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
    return Paper(said["paper"], said["claims"], ranges)
