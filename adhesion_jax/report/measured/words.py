"""The verdict on a measured record in words."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pandas as pd

from adhesion_jax.data import Measured
from adhesion_jax.data.events import Chosen
from adhesion_jax.identifiers.base import Status
from adhesion_jax.inference.fit import MeasuredFit
from adhesion_jax.inference.noise import SlipNoise
from adhesion_jax.inference.sandwich import COSINES
from adhesion_jax.inference.weighing import EXACT
from adhesion_jax.measured.answer import Answer
from adhesion_jax.measured.comparison import Comparison
from adhesion_jax.measured.groups import Group
from adhesion_jax.measured.residual import Residual
from adhesion_jax.measured.vetoes import Judgement
from adhesion_jax.report.rendering import Sections, sections_of, sentences_of
from adhesion_jax.report.text import filled
from adhesion_jax.wording import listed

#: The residual is said to have structure if the likeness of its neighbours exceeds this number of
#: standard deviations.
_LIKENESS = 2.0

#: Least weight at which a curve is named as part of the answer.
_LEAST_NAMED = 0.005

#: Curves are told apart if their log densities differ by this multiple of its standard error.
_APART = 2.0

#: Autocorrelation, run scatter, slow level and departure below this are not worth a number.
_SLIGHT = 5e-4


@dataclass(frozen=True, eq=False, repr=False)
class Identified:
    """What measured points say of the peak, and of every curve that was fitted to them."""

    measured: Measured
    logs: Sequence[Chosen]
    citation: str
    fits: Mapping[str, MeasuredFit]
    not_fitted: Mapping[str, Sequence[str]]
    residuals: Mapping[str, Residual]
    answer: Answer
    judgement: Judgement
    slip: SlipNoise
    runs: Sequence[str]
    comparison: Comparison | None
    groups: Mapping[str, Group]
    branches: Comparison | None
    in_vain: Sequence[str] | None
    mixed: Comparison | None

    @property
    def title(self) -> str:
        return Path(self.measured.name).name

    @property
    def ranked(self) -> list[str]:
        """The names of the curves, the one that predicts best what was left out first."""
        return sorted(self.fits, key=lambda name: -self.fits[name].log_density)

    @property
    def best(self) -> str:
        """The name of the curve that predicts best what was left out of its fit."""
        return self.ranked[0]

    @property
    def fit(self) -> MeasuredFit:
        """The fit of the best curve, with covariance, noise and status."""
        return self.fits[self.best]


def verdict(found: Identified) -> Sections:
    """The verdict in sentences under titles: what forbids an answer comes first."""
    ranked, fits, best, left = found.ranked, found.fits, found.fit, found.residuals[found.best]
    second = fits[ranked[min(1, len(ranked) - 1)]]
    by_part = best.left_out - second.left_out
    departure, at_slip = _departure(best)
    table = found.measured.table
    slips, adhesion = table[found.measured.slip], table["adhesion"]
    mixed = different_rails(None, {}, found.mixed)
    told = {
        **vars(found),
        "citation": " ".join(filter(None, (*(log.sentence for log in found.logs), found.citation))),
        "left": left,
        "runs": len(found.runs),
        "ranked": ranked,
        "warnings": [*filter(None, [mixed, found.judgement.warning])],
        "braking": int(((slips < 0) & (adhesion < 0)).sum()),
        "apart": int((slips * adhesion < 0).sum()),
        "departure": departure,
        "at_slip": at_slip,
        "gain": best.log_density - second.log_density,
        "gain_se": float(np.sqrt(by_part.size) * np.std(by_part)),
        "weights": weights_of(found.answer),
        "exact_fit": best.rms <= EXACT * np.sqrt(np.mean(left.adhesion**2)),
        "compared": [(one, *_ends(one.table)) for one in (found.comparison, found.branches) if one],
        "untrusted": [
            (name, reasons(fits[name]))
            for name in ranked
            if fits[name].status is not Status.TRUSTED
        ],
        "exact": EXACT,
        "cosines": COSINES,
        "slight": _SLIGHT,
        "most_alike": _LIKENESS,
        "apart_errors": _APART,
    }
    return sections_of("identify.txt", **told)


def _ends(table: pd.DataFrame) -> tuple[pd.Series, pd.Series]:
    """The rows of the smallest and of the largest adhesion."""
    order = np.argsort(table["mu_max"].to_numpy())
    return table.iloc[order[0]], table.iloc[order[-1]]


def _departure(fit: MeasuredFit) -> tuple[float, float]:
    """How far the points leave the nearest curve where they do most, as a share; and the slip."""
    slip = np.linspace(0.02, 1.0, 50) * fit.law.span.largest
    alone = np.asarray(fit.curve(jnp.asarray(slip), fit.conditions))
    departure = (fit.law.at(slip).adhesion - alone) / np.abs(alone).max()
    most = int(np.argmax(np.abs(departure)))
    return float(departure[most]), float(slip[most])


def weights_of(answer: Answer) -> str:
    """The weights of the curves that are worth a name, the heaviest first."""
    weights = {name: weight for name, weight in answer.weights.items() if weight >= _LEAST_NAMED}
    heaviest = sorted(weights, key=lambda name: -weights[name])
    return listed([f"{name} {weights[name]:.2f}" for name in heaviest])


def in_lines(sections: Sections) -> str:
    """The verdict for a terminal and a text file."""
    return "\n".join(filled(f"{title}: {' '.join(sentences)}") for title, sentences in sections)


def reasons(fit: MeasuredFit) -> list[str]:
    """Every reason why a fit may not be trusted, as sentences; that of TRUSTED if there is none."""
    parameters = zip(fit.curve.free, fit.parameters, fit.on_bound, fit.no_influence, strict=True)
    told = sentences_of("reasons.txt", fit=fit, known=Status, parameters=[*parameters])
    return told or [Status.TRUSTED.sentence]


def different_rails(
    comparison: Comparison | None, groups: Mapping[str, Group], mixed: Comparison | None
) -> str:
    """What is said before one answer for rows of different rails; empty for most measurements."""
    return " ".join(sentences_of("rails.txt", comparison=comparison, groups=groups, mixed=mixed))
