"""Settings that no paper prints, drawn from declared ranges."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from adhesion_jax.report.traction.panels import Panel
from experiments.claims.claim import ASSUMED, Claim, judged, of_settings

Numbers = NDArray[np.float64]
Flags = NDArray[np.bool_]

#: The number of settings that are drawn, a power of two as Sobol's sequence asks for.
DRAWS = 64


class Range(NamedTuple):
    """What a number may be: the value used elsewhere here, and the ends between which it is drawn.

    Drawn evenly, or evenly in its logarithm.
    """

    own: float
    low: float
    high: float
    by_ratio: bool = False


#: A setting: a number for each name.
Setting = Mapping[str, float]


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


def over_settings(
    paper: str,
    claim: str,
    ours: Numbers,
    unit: str,
    holds: Flags,
    remark: str,
    printed: float = np.nan,
) -> Claim:
    """A claim from its number at our setting and at those drawn, and whether it holds in each."""
    verdict = of_settings(holds[1:])
    return judged(paper, claim, float(ours[0]), unit, verdict, ASSUMED, remark, printed)


class Cloud(NamedTuple):
    """A claim over the settings, our own first: what is drawn of it."""

    title: str
    x_label: str
    x: Numbers
    y_label: str
    y: Numbers
    holds: Flags


class Found(NamedTuple):
    """The claims of a control system, the one over the settings that matters most, and more to
    draw.
    """

    claims: Sequence[Claim]
    cloud: Cloud
    panels: Sequence[Panel] = ()
